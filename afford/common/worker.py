"""What a worker process does before a task, so that the same key gives the same bytes: threads, seeds, kernel caches."""

from __future__ import annotations

import os
import random
import sys
from pathlib import Path
from typing import Any

DYNAMIC = ()  # sys.modules is counted, and no module of ours is taken out of it
VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
FONTS = "sealed-matplotlib"
SEALED = "verified-"
"""begins the names of folders of compiled code that is verified before it is used"""


def prepare(seed: int, threads: int) -> None:
    """Fix the thread count and the global random states of every numeric library that is loaded, or will be.

    Libraries that are loaded later read the environment; those that are there already are limited through threadpoolctl. torch
    gets the seed and threads of the running task when a stage imports it.

    Intel's IPP inside OpenCV stays off: some of its results depend, in the last bit, on where in memory an array lies.
    """
    for name in VARIABLES:
        os.environ[name] = str(threads)
    import cv2
    import numpy as np

    from afford.common.loading import seal_fonts, seal_kernels, when_loaded

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
    if FONTS in os.environ.get("MPLCONFIGDIR", ""):
        seal_fonts(Path(os.environ["MPLCONFIGDIR"]))


class _Pools:
    """The native thread pools of this process, looked for again when modules were loaded since."""

    def __init__(self) -> None:
        self.modules, self.threads = 0, 0
        self.controller: Any = None


_pools = _Pools()


def _limit(threads: int) -> None:
    """Limit every BLAS and OpenMP library that is loaded."""
    from threadpoolctl import ThreadpoolController

    if _pools.modules == len(sys.modules) and _pools.threads == threads:
        return
    if _pools.modules != len(sys.modules):
        _pools.controller = ThreadpoolController()
    _pools.controller.limit(limits=threads)
    _pools.modules, _pools.threads = len(sys.modules), threads


def kernel_sources(root: Path) -> list[Path]:
    """Every file of ours that compiles numba kernels, or holds constants that they may use."""
    return sorted(path for path in (root / "afford").rglob("*.py"))


def use_kernel_cache(root: Path, store: Path) -> Path:
    """Point numba's cache into the store, in a folder named after the digest of the sources it compiles. Its files are sealed."""
    from blake3 import blake3

    from afford.common.loading import seal_kernels, when_loaded

    digest = blake3()
    for path in kernel_sources(root):
        digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    folder = store / ".cache" / "numba" / (SEALED + digest.hexdigest(16))
    os.environ["NUMBA_CACHE_DIR"] = str(folder)
    when_loaded("numba.core.caching", seal_kernels)
    return folder


def use_font_cache(store: Path) -> None:
    """Let matplotlib keep its list of fonts in the store, with a digest, and look for no settings in the home folder."""
    from afford.common.loading import seal_fonts

    os.environ["MPLCONFIGDIR"] = str(store / ".cache" / FONTS)
    seal_fonts(store / ".cache" / FONTS)
