"""Cache of compiled numba kernels, shared by the tests and processes of one test run."""

from __future__ import annotations

from pathlib import Path

from afford.common.worker import use_kernel_cache

ROOT = Path(__file__).resolve().parents[2]


def share_kernels(tmp_path: Path) -> Path:
    """Point numba's cache of this process and its workers to one folder for all tests of the run; return that folder."""
    base = tmp_path.parent
    return use_kernel_cache(ROOT, (base.parent if base.name.startswith("popen-") else base) / "kernels")
