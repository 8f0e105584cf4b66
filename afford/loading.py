"""Actions on libraries at the moment they are imported: seeds for one that loads late, checksums for what they keep in a cache."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable, Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import Any

from blake3 import blake3

DYNAMIC = ()  # what is watched are packages of others: no module of ours is loaded through the import machinery here
DIGEST_BYTES = 32
COMPILED = (".nbi", ".nbc")
"""numba's files: an index of a function's signatures, and the machine code of one"""

FONTS = "fontlist-*.json"

_actions: dict[str, Callable[[Any], None]] = {}


class _Watcher(MetaPathFinder):
    """Finds no module itself: it lets the others find one, and appends the action to what loading it does."""

    def find_spec(self, name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> ModuleSpec | None:
        if name not in _actions:
            return None
        others = (finder for finder in sys.meta_path if finder is not self)
        spec = next((found for finder in others if (found := finder.find_spec(name, path, target))), None)
        if spec is not None and spec.loader is not None:
            _append(spec, name)
        return spec


def _append(spec: ModuleSpec, name: str) -> None:
    loader: Any = spec.loader
    load = loader.exec_module

    def exec_module(module: ModuleType) -> None:
        load(module)
        _actions[name](module)

    loader.exec_module = exec_module


_watcher = _Watcher()


def when_loaded(name: str, action: Callable[[Any], None]) -> None:
    """Call `action` with module `name`: now when it is loaded, else as soon as it is. A later action replaces an earlier one."""
    _actions[name] = action
    if name in sys.modules:
        action(sys.modules[name])
    elif _watcher not in sys.meta_path:
        sys.meta_path.insert(0, _watcher)


def seal_kernels(caching: Any) -> None:
    """Give `numba.core.caching` an `open` of its own, which writes a BLAKE3 digest in front of every compiled file and verifies it
    before the file is unpickled or run. A file that does not fit is deleted, and compiled again."""
    caching.open = open_sealed


def open_sealed(path: Any, mode: str = "r", *more: Any) -> Any:
    """As `open`; files of compiled code are sealed. FileNotFoundError when one does not fit its digest."""
    if not any(suffix in os.path.basename(path) for suffix in COMPILED):
        return open(path, mode, *more)
    if mode == "wb":
        return _Sealing(path)
    with open(path, "rb") as file:
        data = file.read()
    if blake3(data[DIGEST_BYTES:]).digest() != data[:DIGEST_BYTES]:
        os.unlink(path)
        raise FileNotFoundError(f"{path} was damaged and is deleted; it is compiled again")
    return io.BytesIO(data[DIGEST_BYTES:])


class _Sealing(io.BytesIO):
    """A file that is written, its digest first, when it is closed."""

    def __init__(self, path: Any) -> None:
        super().__init__()
        self._path = path

    def close(self) -> None:
        """Write the file."""
        if not self.closed:
            data = self.getvalue()
            with open(self._path, "wb") as file:
                file.write(blake3(data).digest() + data)
        super().close()


def seal_fonts(folder: Path) -> None:
    """Delete matplotlib's list of fonts in `folder` where it does not fit the digest beside it, and put a digest beside a list that
    matplotlib makes."""
    for path in folder.glob(FONTS):
        if not _digest_of(path).exists() or _digest_of(path).read_text() != blake3(path.read_bytes()).hexdigest():
            path.unlink()
            _digest_of(path).unlink(missing_ok=True)

    def note(_: Any) -> None:
        for path in folder.glob(FONTS):
            if not _digest_of(path).exists():
                partial = path.with_name(f".{path.name}.{os.getpid()}")
                partial.write_text(blake3(path.read_bytes()).hexdigest())
                partial.replace(_digest_of(path))

    if "matplotlib.font_manager" not in _actions:
        when_loaded("matplotlib.font_manager", note)


def _digest_of(path: Path) -> Path:
    return path.with_suffix(".blake3")
