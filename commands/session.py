"""A runner on the store that the user names, with the project's own codec and worker hook."""

from __future__ import annotations

import os
from pathlib import Path

from afford.worker import use_font_cache, use_kernel_cache
from runner import Runner

ROOT = Path(__file__).resolve().parent.parent
STORE = ROOT / "artifacts"
CODEC, WORKER = "afford.codecs:CODEC", "afford.worker:prepare"
DEFAULT_JOBS = max(1, len(os.sched_getaffinity(0)))


def open_runner(store: Path | None = None, jobs: int | None = None, rehash: bool = False) -> Runner:
    """A runner; StoreError when the store cannot be written to. Memory: what is free when it starts, less a margin."""
    folder = (store or STORE).absolute()
    use_kernel_cache(ROOT, folder)
    use_font_cache(folder)
    return Runner(folder, ROOT, CODEC, WORKER, jobs=DEFAULT_JOBS if jobs is None else jobs, memory_gib=_memory_gib(), rehash=rehash)


def _memory_gib() -> float:
    """Memory that tasks may declare together: three quarters of what the machine has free, at most 6 GiB per two workers."""
    pages, size = os.sysconf("SC_AVPHYS_PAGES"), os.sysconf("SC_PAGE_SIZE")
    return max(2.0, min(0.75 * pages * size / 2**30, 3.0 * DEFAULT_JOBS))
