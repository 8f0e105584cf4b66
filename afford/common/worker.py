"""Set-up of a worker process, so that equal keys give equal bytes: threads, seeds, caches of compiled code.

Libraries that load late are seeded when they are imported. Cached machine code and font lists are verified by a digest before use.
"""

from __future__ import annotations

import io
import os
import random
import sys
from collections.abc import Callable, Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import Any

from blake3 import blake3

DYNAMIC = ()  # sys.modules is only counted
VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
FONT_FOLDER = "sealed-matplotlib"
SEALED = "verified-"
"""prefix of folders of compiled code that is verified before use"""


def prepare(seed: int, threads: int) -> None:
    """Set the thread count and the random seeds of every numeric library, loaded now or later.

    Libraries that load later read the environment; threadpoolctl limits those that are already loaded. torch gets the seed and
    threads of the running task when a stage imports it. Intel's IPP inside OpenCV is off, because the last bit of some of its
    results depends on the memory address of an array.
    """
    for name in VARIABLES:
        os.environ[name] = str(threads)
    import cv2
    import numpy as np

    _limit(threads)
    cv2.setNumThreads(threads)
    cv2.ipp.setUseIPP(False)
    cv2.setRNGSeed(seed & 0x7FFFFFFF)
    random.seed(seed)
    np.random.seed(seed & 0xFFFFFFFF)

    def torch_too(torch: Any) -> None:
        torch.set_num_threads(threads)
        torch.manual_seed(seed)

    when_loaded("torch", torch_too)
    if SEALED in os.environ.get("NUMBA_CACHE_DIR", ""):
        when_loaded("numba.core.caching", seal_kernels)
    if FONT_FOLDER in os.environ.get("MPLCONFIGDIR", ""):
        seal_fonts(Path(os.environ["MPLCONFIGDIR"]))


class _Pools:
    """Native thread pools of this process, searched again when modules were loaded since."""

    def __init__(self) -> None:
        self.modules, self.threads = 0, 0
        self.controller: Any = None


_pools = _Pools()


def _limit(threads: int) -> None:
    """Limit the threads of every BLAS and OpenMP library that is loaded."""
    from threadpoolctl import ThreadpoolController

    if _pools.modules == len(sys.modules) and _pools.threads == threads:
        return
    if _pools.modules != len(sys.modules):
        _pools.controller = ThreadpoolController()
    _pools.controller.limit(limits=threads)
    _pools.modules, _pools.threads = len(sys.modules), threads


def kernel_sources(root: Path) -> list[Path]:
    """List every file that compiles numba kernels or defines constants for them."""
    return sorted(path for path in (root / "afford").rglob("*.py"))


def use_kernel_cache(root: Path, store: Path) -> Path:
    """Set numba's cache to a folder of the store whose name is the digest of the kernel sources. Its files are sealed."""
    digest = blake3()
    for path in kernel_sources(root):
        digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    folder = store / ".cache" / "numba" / (SEALED + digest.hexdigest(16))
    os.environ["NUMBA_CACHE_DIR"] = str(folder)
    when_loaded("numba.core.caching", seal_kernels)
    return folder


def use_font_cache(store: Path) -> None:
    """Set matplotlib's font list to a file in the store, with a digest, and ignore the settings in the home folder."""
    os.environ["MPLCONFIGDIR"] = str(store / ".cache" / FONT_FOLDER)
    seal_fonts(store / ".cache" / FONT_FOLDER)


DIGEST_SUFFIX = ".blake3"
COMPILED = (".nbi", ".nbc")
"""suffixes of numba's files: the index of a function's signatures, and machine code"""

FONT_LISTS = "fontlist-*.json"

_actions: dict[str, Callable[[Any], None]] = {}


class _Watcher(MetaPathFinder):
    """Module finder that runs an action after another finder has loaded a module."""

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
    """Call `action` with module `name`: now if it is loaded, otherwise right after its import.

    A later action replaces an earlier one.
    """
    _actions[name] = action
    if name in sys.modules:
        action(sys.modules[name])
    elif _watcher not in sys.meta_path:
        sys.meta_path.insert(0, _watcher)


def seal_kernels(caching: Any) -> None:
    """Replace the `open` of `numba.core.caching` by one that seals compiled files with a BLAKE3 digest.

    Every file is verified before it is unpickled or run. A file with a wrong or missing digest is deleted and compiled again. The
    format of the files is unchanged, so that a process without this `open` can share them.
    """
    caching.open = open_sealed


def open_sealed(path: Any, mode: str = "r", *more: Any) -> Any:
    """Open a file; compiled files are verified by their digest. FileNotFoundError for a wrong digest."""
    name = str(path)
    if not any(suffix in os.path.basename(name) for suffix in COMPILED):
        return open(path, mode, *more)
    if mode == "wb":
        return _Sealing(name)
    data = Path(name).read_bytes()
    digest = Path(name + DIGEST_SUFFIX)
    if not digest.exists() or digest.read_bytes() != blake3(data).digest():
        os.unlink(name)
        raise FileNotFoundError(f"{name} was damaged and is deleted; it is compiled again")
    return io.BytesIO(data)


class _Sealing(io.BytesIO):
    """Output file that writes its digest when it is closed."""

    def __init__(self, path: str) -> None:
        super().__init__()
        self._path = path

    def close(self) -> None:
        """Write the digest for the final name, then the file under its temporary name, which numba renames."""
        if not self.closed:
            data = self.getvalue()
            Path(self._path.partition(".tmp.")[0] + DIGEST_SUFFIX).write_bytes(blake3(data).digest())
            Path(self._path).write_bytes(data)
        super().close()


def seal_fonts(folder: Path) -> None:
    """Delete a font list of matplotlib whose digest is wrong, and write a digest for each new list."""
    for path in folder.glob(FONT_LISTS):
        if not _digest_of(path).exists() or _digest_of(path).read_text() != blake3(path.read_bytes()).hexdigest():
            path.unlink()
            _digest_of(path).unlink(missing_ok=True)

    def note(_: Any) -> None:
        for path in folder.glob(FONT_LISTS):
            if not _digest_of(path).exists():
                partial = path.with_name(f".{path.name}.{os.getpid()}")
                partial.write_text(blake3(path.read_bytes()).hexdigest())
                partial.replace(_digest_of(path))

    if "matplotlib.font_manager" not in _actions:
        when_loaded("matplotlib.font_manager", note)


def _digest_of(path: Path) -> Path:
    return path.with_suffix(".blake3")
