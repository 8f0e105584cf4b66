"""Project modules, found under a root folder, parsed once and cached by their file stamps.

The stamp of a file is taken before and after the read that is parsed, and so belongs to that text. One read serves both the
fingerprint and the check that the code has not been edited since.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterable
from dataclasses import asdict
from functools import cached_property
from pathlib import Path
from typing import Any

from blake3 import blake3

from runner.canonical import digest, file_digest
from runner.files import RACY_NS, Source, Stamp, read_cache, stamp, write_cache
from runner.source import Module, SourceError, parse_module

FIRST: dict[str, list[Any]] = {}
LAST: dict[str, list[Any]] = {}
"""path -> statements and imports at the first and the last time that this process read the file"""


def outdated(paths: Iterable[str]) -> str | None:
    """First of these files that changed since this process imported its module; None if there is none.

    The code that runs in this process then differs from the file.
    """
    edited = [path for path in paths if FIRST.get(path) != LAST.get(path)]
    loaded = {getattr(module, "__file__", None) for module in list(sys.modules.values())} if edited else set()
    return next((path for path in edited if path in loaded), None)


DEPTH = 4
"""maximum depth of the first module below a folder without __init__.py"""


class Snapshot:
    """Identity of one state of the code; analysis results are valid for this state alone."""


class Modules:
    """Project modules by dotted name.

    `schemas` are packages whose doc lines do not count; `cache` may be None.
    """

    def __init__(self, root: Path, cache: Path | None = None, schemas: tuple[str, ...] = ("schemas",)) -> None:
        self.root, self._cache, self._schemas = root, cache, schemas
        self.snapshot = Snapshot()
        self._modules: dict[str, Module | None] = {}
        self._stamps: dict[str, Stamp] = {}
        self._contents: dict[str, str] = {}
        """path -> digest of the bytes that were read"""
        self._assumed: dict[str, Stamp] = {}
        """path -> stamp of a file whose fingerprints were taken from a cache, without a read"""
        self._fresh = False
        self.version = _version(schemas)

    @cached_property
    def _saved(self) -> dict[str, list]:
        """Parsed modules of earlier processes."""
        saved = read_cache(self._cache) if self._cache is not None else {}
        return dict(saved["modules"]) if saved.get("version") == self.version else {}

    def assume(self, files: dict[str, list[Any]], missing: list[str]) -> bool:
        """Take the stamps and contents of source files from a cache; False when a file or a module name has changed.

        `files` maps a path to its stamp and the digest of its content; `missing` are module names without a module.
        """
        for path, (before, _) in files.items():
            try:
                if list(stamp(path)) != before:
                    return False
            except FileNotFoundError:
                return False
        if any(self._find(name) is not None for name in missing):
            return False
        self._assumed = {path: (before[0], before[1], before[2], before[3]) for path, (before, _) in files.items()}
        self._stamps |= self._assumed
        self._contents |= {path: content for path, (_, content) in files.items()}
        self._modules |= dict.fromkeys(missing)
        return True

    def seen(self) -> tuple[dict[str, list[Any]], list[str]]:
        """Stamp and content of every source file since `renew`, and the module names without a module."""
        files = {path: [list(known), self._contents[path]] for path, known in self._stamps.items() if path in self._contents}
        return files, [name for name, module in self._modules.items() if module is None]

    @property
    def schemas(self) -> tuple[str, ...]:
        """Packages whose doc lines do not count."""
        return self._schemas

    def renew(self) -> None:
        """Drop all parsed modules if a file was edited, or a missing module was added."""
        if self._is_current():
            return
        self._modules.clear()
        self._stamps.clear()
        self._contents.clear()
        self.snapshot = Snapshot()

    def _is_current(self) -> bool:
        same = all(os.path.exists(path) and stamp(path) == known for path, known in self._stamps.items())
        return same and all(self._find(name) is None for name, module in list(self._modules.items()) if module is None)

    def source(self, path: str) -> Source:
        """Source file as it was at its first read since `renew`."""
        before = self.stamp(path)
        if path not in self._contents:
            self._contents[path] = file_digest(Path(path))
            if stamp(path) != before:
                raise SourceError(f"{path}:1: the file was edited while it was read; run again")
        return Source(os.path.relpath(path, self.root), self._contents[path], before)

    def stamp(self, path: str) -> Stamp:
        """Stamp of a file at its first read since `renew`."""
        if path not in self._stamps:
            self._stamps[path] = stamp(path)
        return self._stamps[path]

    def get(self, name: str) -> Module | None:
        """Project module of this name; None for a module outside the project."""
        if name not in self._modules:
            self._modules[name] = self._find(name)
        return self._modules[name]

    def save(self) -> None:
        """Write parsed modules to the cache."""
        if self._cache is not None and self._fresh:
            write_cache(self._cache, {"version": self.version, "modules": self._saved})
            self._fresh = False

    def _find(self, name: str) -> Module | None:
        holder = self.get(name.rpartition(".")[0]) if "." in name else None
        if holder is not None and not holder.is_package:
            return None
        base = self.root.joinpath(*name.split("."))
        module, package = base.with_name(base.name + ".py"), base / "__init__.py"
        if module.is_file():
            if package.is_file():
                raise SourceError(f"{module}:1: {package} has the same name and takes precedence; rename one of them")
            return self._read(name, module, False)
        if package.is_file():
            return self._read(name, package, True)
        return Module(name, str(base)) if base.is_dir() and self._holds_code(name, base) else None

    def _holds_code(self, name: str, folder: Path) -> bool:
        """Return True when a folder without __init__.py contains modules and its name is not in the standard library."""
        below = any(next(folder.glob(f"{'*/' * depth}*.py"), None) for depth in range(DEPTH))
        return below and name.partition(".")[0] not in sys.stdlib_module_names

    def _read(self, name: str, path: Path, package: bool) -> Module:
        before = self._assumed.pop(str(path), None)
        if before is not None and str(path) not in FIRST:  # the file was current when this process began
            saved = self._saved.get(name)
            known = saved is not None and tuple(saved[0]) == before
            FIRST[str(path)] = _code(Module(**saved[1] | {"path": str(path)})) if known and saved else ["not read"]
        module = self._parsed(name, path, package)
        LAST[str(path)] = _code(module)
        FIRST.setdefault(str(path), LAST[str(path)])
        return module

    def _parsed(self, name: str, path: Path, package: bool) -> Module:
        now = self.stamp(str(path))
        if name in self._saved and self._saved[name][0] == list(now):
            self._contents[str(path)] = self._saved[name][2]
            return Module(**self._saved[name][1] | {"path": str(path)})
        data = path.read_bytes()
        if stamp(path) != now:  # the file changed during the read: read it again
            del self._stamps[str(path)]
            return self._parsed(name, path, package)
        self._contents[str(path)] = blake3(data).hexdigest()
        module = parse_module(name, str(path), data.decode("utf-8"), package, name.partition(".")[0] in self._schemas)
        if time.time_ns() - now[3] > RACY_NS:
            self._saved[name] = [list(now), asdict(module), self._contents[str(path)]]
            self._fresh = True
        return module


def _code(module: Module) -> list[Any]:
    """Content of a module, including the locations of its imports."""
    named = [[found.get("imports"), found.get("strings")] for found in module.statements if {"imports", "strings"} & found.keys()]
    return [[found["digest"] for found in module.statements], named, module.imports]


def _version(schemas: tuple[str, ...]) -> str:
    """Version of the cached form: digest of the parser's own source files and of Python's version."""
    own = [stamp(Path(__file__).with_name(name)) for name in (
        "source.py", "spelling.py", "names.py", "scopes.py", "external.py", "modules.py", "canonical.py")]
    return digest("afford-parser", [own, list(sys.version_info[:3]), list(schemas)])
