"""Compiled numba kernels, shared by all tests and processes of a test run, and by later runs on the same sources."""

from __future__ import annotations

import shutil
from pathlib import Path

from afford.common.kernel_cache import use_kernel_cache

ROOT = Path(__file__).resolve().parents[2]
KERNELS = use_kernel_cache(ROOT / ".pytest_cache")
"""numba's cache of this process, and of processes that it starts without a cache of their own"""


def use_shared_kernels(store: Path) -> Path:
    """Set numba's cache to the shared one, in place of `use_kernel_cache`."""
    return use_kernel_cache(ROOT / ".pytest_cache")


def copy_kernels(store: Path) -> None:
    """Copy the shared kernels into the cache of a store, for commands that run in a process of their own."""
    if KERNELS.exists():
        shutil.copytree(KERNELS, store / ".cache" / "numba", dirs_exist_ok=True)
