"""The modules of the project, found under its root, parsed once and remembered by size, mtime and inode."""

from __future__ import annotations

import json
import sys
import time
from dataclasses import asdict
from pathlib import Path

from runner.canonical import digest
from runner.files import RACY_NS, read_cache, stamp, write_atomic
from runner.source import Module, SourceError, parse_module


class Modules:
    """Project modules by dotted name. `schemas` are packages whose doc lines do not count; `cache` may be None."""

    def __init__(self, root: Path, cache: Path | None = None, schemas: tuple[str, ...] = ("schemas",)) -> None:
        self.root, self._cache, self._schemas = root, cache, schemas
        self._modules: dict[str, Module | None] = {}
        self._saved: dict[str, list] = {}
        self._fresh = False
        self._version = _version(schemas)
        saved = read_cache(cache) if cache is not None else None
        if saved and saved["version"] == self._version:
            self._saved = saved["modules"]

    def get(self, name: str) -> Module | None:
        """The module, or None when it is not one of ours."""
        if name not in self._modules:
            self._modules[name] = self._find(name)
        return self._modules[name]

    def save(self) -> None:
        """Write what was parsed, at once."""
        if self._cache is not None and self._fresh:
            write_atomic(self._cache, json.dumps({"version": self._version, "modules": self._saved}).encode())
            self._fresh = False

    def _find(self, name: str) -> Module | None:
        holder = self.get(name.rpartition(".")[0]) if "." in name else None
        if holder is not None and not holder.is_package:
            return None
        base = self.root.joinpath(*name.split("."))
        module, package = base.with_name(base.name + ".py"), base / "__init__.py"
        if module.is_file():
            if package.is_file():
                raise SourceError(f"{module}:1: {package} has the same name, and Python imports that one; rename one of them")
            return self._read(name, module, False)
        if package.is_file():
            return self._read(name, package, True)
        return Module(name, str(base)) if base.is_dir() and self._holds_code(name, base) else None

    def _holds_code(self, name: str, folder: Path) -> bool:
        """A folder without __init__.py is a package when it has modules, and is not an installed one's name."""
        return next(folder.glob("*.py"), None) is not None and name.partition(".")[0] not in sys.stdlib_module_names

    def _read(self, name: str, path: Path, package: bool) -> Module:
        now = list(stamp(path))
        if name in self._saved and self._saved[name][0] == now:
            return Module(**self._saved[name][1])
        schema = name.partition(".")[0] in self._schemas
        module = parse_module(name, str(path), path.read_text(encoding="utf-8"), package, schema)
        if time.time_ns() - now[1] > RACY_NS:
            self._saved[name] = [now, asdict(module)]
            self._fresh = True
        return module


def _version(schemas: tuple[str, ...]) -> str:
    """What the remembered form depends on: our own parser, and Python's."""
    own = [stamp(Path(__file__).with_name(name)) for name in (
        "source.py", "names.py", "scopes.py", "touches.py", "foreign.py", "modules.py", "canonical.py")]
    return digest("afford-parser", [own, list(sys.version_info[:3]), list(schemas)])
