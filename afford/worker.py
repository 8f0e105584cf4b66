"""What a worker process does before a task, so that the same key gives the same bytes: threads, seeds, kernel caches."""

from __future__ import annotations

import os
import sys
from pathlib import Path


def prepare(seed: int, threads: int) -> None:
    """Fix the thread count and the global random states of every numeric library that is loaded, or will be.

    Intel's IPP inside OpenCV stays off: some of its results depend, in the last bit, on where in memory an array lies.
    """
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ[name] = str(threads)
    import cv2
    import numpy as np

    cv2.setNumThreads(threads)
    cv2.ipp.setUseIPP(False)
    cv2.setRNGSeed(seed & 0x7FFFFFFF)
    np.random.seed(seed & 0xFFFFFFFF)
    torch = sys.modules.get("torch")
    if torch is not None:
        torch.set_num_threads(threads)
        torch.manual_seed(seed)


def kernel_sources(root: Path) -> list[Path]:
    """Every file of ours that compiles numba kernels, or holds constants that they may use."""
    return sorted(path for path in (root / "afford").rglob("*.py"))


def use_kernel_cache(root: Path, store: Path) -> Path:
    """Point numba's cache into the store, in a folder named after the digest of the sources it compiles."""
    from blake3 import blake3

    digest = blake3()
    for path in kernel_sources(root):
        digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    folder = store / ".cache" / "numba" / digest.hexdigest(16)
    os.environ["NUMBA_CACHE_DIR"] = str(folder)
    return folder


def use_font_cache(store: Path) -> None:
    """Let matplotlib keep its list of fonts in the store, and look for no settings in the home folder."""
    os.environ["MPLCONFIGDIR"] = str(store / ".cache" / "matplotlib")
