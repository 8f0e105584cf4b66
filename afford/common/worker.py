"""Set-up of a worker process, so that equal keys give equal bytes: threads, seeds, the list of fonts.

Libraries that load late are seeded when they are imported. The list of fonts is verified by a digest before use; so is compiled
code (`afford.common.kernel_cache`).
"""

from __future__ import annotations

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


def use_font_cache(store: Path) -> None:
    """Set matplotlib's font list to a file in the store, with a digest, and ignore the settings in the home folder."""
    os.environ["MPLCONFIGDIR"] = str(store / ".cache" / FONT_FOLDER)
    seal_fonts(store / ".cache" / FONT_FOLDER)


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
