"""A runner on the store that the user names, with the project's own codec and worker hook."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path

from afford.common.worker import use_font_cache, use_kernel_cache
from commands.errors import UsageError
from runner import Runner, is_store

ROOT = Path(__file__).resolve().parent.parent
STORE = ROOT / "artifacts"
CODEC, WORKER = "afford.codecs:CODEC", "afford.common.worker:prepare"
ANNOUNCED_BYTES = 1 << 30
FREE_PAGES = "SC_AVPHYS_PAGES"
"""what Linux calls them; macOS does not tell"""


def cores() -> int:
    """Cores that this process may use; all of the machine where the system does not tell them apart."""
    return max(1, len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1)


DEFAULT_JOBS = cores()


def open_runner(store: Path | None = None, jobs: int | None = None, rehash: bool = False, plan_only: bool = False) -> Runner:
    """A runner; StoreError when the store cannot be written to, UsageError when it is a file. Memory: what is free when it starts,
    less a margin. `plan_only`: for plans, which read no large file that was never hashed.
    """
    folder = (store or STORE).absolute()
    there = next(path for path in (folder, *folder.parents) if os.path.exists(path))
    if not there.is_dir():
        raise UsageError(f"--store {folder}: expected a folder, got the file {there}; name another")
    use_kernel_cache(ROOT, folder)
    use_font_cache(folder)
    return Runner(folder, ROOT, CODEC, WORKER, jobs=DEFAULT_JOBS if jobs is None else jobs, memory_gib=_memory_gib(),
                  rehash=rehash, plan_only=plan_only)


def open_existing(store: Path | None = None, plan_only: bool = False) -> Runner:
    """A runner on a store that is there, for verbs that only look. UsageError where there is none, and nothing is made."""
    folder = store or STORE
    if not is_store(folder):
        got = "a folder that is none" if os.path.isdir(folder) else "a file" if os.path.exists(folder) else "nothing there"
        raise UsageError(f"--store {folder}: expected a store that a run has made, got {got}; name it, or make one with "
                         "`pipeline.py run`")  # fmt: skip
    return open_runner(store, plan_only=plan_only)


def digester(runner: Runner) -> Callable[[Path], str]:
    """The digest of a file of a source. Large ones that have to be read for it, once, are announced."""
    def digest(path: Path) -> str:
        if not runner.store.memo.plan_only and path.stat().st_size > ANNOUNCED_BYTES and not runner.is_hashed(path):
            sys.stderr.write(f"reading {path.name} ({path.stat().st_size / 1e9:.1f} GB); it is remembered\n")
        return runner.hash_file(path)[0]

    return digest


def _memory_gib() -> float:
    """Memory that tasks may declare together: 6 GiB per two workers, at most three quarters of what the machine has free, where it
    tells that.
    """
    if FREE_PAGES not in os.sysconf_names:
        return max(2.0, 3.0 * DEFAULT_JOBS)
    pages, size = os.sysconf(FREE_PAGES), os.sysconf("SC_PAGE_SIZE")
    return max(2.0, min(0.75 * pages * size / 2**30, 3.0 * DEFAULT_JOBS))
