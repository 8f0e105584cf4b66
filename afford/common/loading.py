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
DIGEST = ".blake3"
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
    """Give `numba.core.caching` an `open` of its own, which writes a BLAKE3 digest beside every compiled file and verifies the file
    before it is unpickled or run. One that does not fit, or has no digest, is deleted and compiled again. The files themselves stay
    numba's, so that a process without this `open` can share them.
    """
    caching.open = open_sealed


def open_sealed(path: Any, mode: str = "r", *more: Any) -> Any:
    """As `open`; compiled files have a digest beside them. FileNotFoundError when one does not fit its digest."""
    name = str(path)
    if not any(suffix in os.path.basename(name) for suffix in COMPILED):
        return open(path, mode, *more)
    if mode == "wb":
        return _Sealing(name)
    data = Path(name).read_bytes()
    digest = Path(name + DIGEST)
    if not digest.exists() or digest.read_bytes() != blake3(data).digest():
        os.unlink(name)
        raise FileNotFoundError(f"{name} was damaged and is deleted; it is compiled again")
    return io.BytesIO(data)


class _Sealing(io.BytesIO):
    """A file that is written, with its digest, when it is closed."""

    def __init__(self, path: str) -> None:
        super().__init__()
        self._path = path

    def close(self) -> None:
        """Write the digest beside the final name, then the file under its temporary one, which numba renames."""
        if not self.closed:
            data = self.getvalue()
            Path(self._path.partition(".tmp.")[0] + DIGEST).write_bytes(blake3(data).digest())
            Path(self._path).write_bytes(data)
        super().close()


def seal_fonts(folder: Path) -> None:
    """Delete matplotlib's list of fonts in `folder` where it does not fit the digest beside it, and put a digest beside a list that
    matplotlib makes.
    """
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
