"""Open a runner on the user's store, with the project's codec and worker hook."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from afford.common.kernel_cache import use_kernel_cache
from afford.common.worker import use_font_cache
from commands.errors import UsageError
from runner import Runner, is_store
from runner.execute import WorkerSpec

ROOT = Path(__file__).resolve().parent.parent
STORE = ROOT / "artifacts"
CODEC, WORKER = "afford.codecs:CODEC", "afford.common.worker:prepare"
ANNOUNCED_BYTES = 1 << 30
FREE_PAGES = "SC_AVPHYS_PAGES"
"""name of free pages on Linux; macOS does not report them"""


def cores() -> int:
    """CPU cores that this process may use; all cores of the machine where the system does not distinguish them."""
    return max(1, len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1)


DEFAULT_JOBS = cores()
ENGINES = ("inline", "pool", "ray")


@dataclass(frozen=True)
class EngineChoice:
    """Engine of a run by its name, and the address of a Ray cluster (None: a private one)."""

    name: str | None = None
    address: str | None = None

    def factory(self, jobs: int | None) -> Callable[..., Any] | None:
        """Maker of the engine; None for the usual one. UsageError when the options do not fit together, or Ray is missing."""
        if self.name not in (None, *ENGINES):
            raise UsageError(f"--engine {self.name}: expected {', '.join(ENGINES)}")
        if self.address is not None and self.name != "ray":
            raise UsageError("--address: works only with --engine ray")
        if self.name == "inline" and jobs:
            raise UsageError(f"--jobs {jobs}: --engine inline has no worker processes; leave one of the two out")
        if self.name == "pool" and jobs == 0:
            raise UsageError("--jobs 0: --engine pool needs worker processes; leave one of the two out")
        return ray_factory(self.address, jobs or DEFAULT_JOBS) if self.name == "ray" else None


def ray_factory(address: str | None, jobs: int) -> Callable[..., Any]:
    """Maker of a Ray engine, which raises UsageError when the cluster does not answer.

    A private cluster has these cores, and the memory limit of a run on this machine.
    """
    from runner.ray_engine import MISSING, RayEngine, RayError

    if find_spec("ray") is None:
        raise UsageError(MISSING)
    own: dict[str, Any] = {} if address else {"jobs": jobs, "memory_gib": _memory_gib()}

    def make(spec: WorkerSpec, offsets: Mapping[str, int]) -> RayEngine:
        try:
            return RayEngine(spec, offsets, address, **own)
        except RayError as error:
            raise UsageError(f"--engine ray: {error}") from error

    return make


def open_runner(store: Path | None = None, jobs: int | None = None, rehash: bool = False, plan_only: bool = False,
                remote: str | None = None, engine: EngineChoice | None = None) -> Runner:  # fmt: skip
    """Open a runner; StoreError when the store cannot be written to, UsageError when it is a file or `remote` is no valid URL.

    Its memory limit is the free memory at the start, less a margin. `plan_only`: large files that were never hashed are not
    read. `remote` defaults to the environment variable AFFORD_REMOTE.
    """
    folder = (store or STORE).absolute()
    there = next(path for path in (folder, *folder.parents) if os.path.exists(path))
    if not there.is_dir():
        raise UsageError(f"--store {folder}: {there} is a file; name a folder")
    choice = engine or EngineChoice()
    factory = choice.factory(jobs)
    jobs = 0 if choice.name == "inline" else jobs
    use_kernel_cache(folder)
    use_font_cache(folder)
    url = remote or os.environ.get("AFFORD_REMOTE") or None
    if url:
        _show_plainly()
    try:
        return Runner(folder, ROOT, CODEC, WORKER, jobs=DEFAULT_JOBS if jobs is None else jobs, memory_gib=_memory_gib(),
                      rehash=rehash, plan_only=plan_only, remote=url, engine=factory)
    except ValueError as error:
        if not url:
            raise
        raise UsageError(f"--remote: {error}") from None


@cache
def _show_plainly() -> None:
    """Print warnings about the remote store as one line, without the place in the code."""
    from runner.remote import RemoteWarning

    usual = warnings.formatwarning

    def shown(message: Warning | str, category: type[Warning], filename: str, lineno: int, line: str | None = None) -> str:
        return f"warning: {message}\n" if category is RemoteWarning else usual(message, category, filename, lineno, line)

    warnings.formatwarning = shown


def open_existing(store: Path | None = None, plan_only: bool = False, remote: str | None = None) -> Runner:
    """Open a runner on an existing store, for verbs that only read.

    UsageError when there is no store; none is created.
    """
    existing_store(store)
    return open_runner(store, plan_only=plan_only, remote=remote)


def existing_store(store: Path | None = None) -> Path:
    """Folder of an existing store; UsageError when there is none."""
    folder = store or STORE
    if not is_store(folder):
        got = "is not an afford store" if os.path.isdir(folder) else "is a file" if os.path.exists(folder) else "does not exist"
        raise UsageError(f"--store {folder}: {folder} {got}; name an existing store, or create one with `pipeline.py run`")
    return folder


def digester(runner: Runner) -> Callable[[Path], str]:
    """Return a function that hashes source files, and announces the first read of a large one."""
    def digest(path: Path) -> str:
        if not runner.store.memo.plan_only and path.stat().st_size > ANNOUNCED_BYTES and not runner.is_hashed(path):
            sys.stderr.write(f"reading {path.name} ({path.stat().st_size / 1e9:.1f} GB); the digest is remembered\n")
        return runner.hash_file(path)[0]

    return digest


def _memory_gib() -> float:
    """Memory limit for concurrent tasks: 6 GiB per two workers, at most three quarters of the free memory.

    The second limit needs a system that reports free memory.
    """
    if FREE_PAGES not in os.sysconf_names:
        return max(2.0, 3.0 * DEFAULT_JOBS)
    pages, size = os.sysconf(FREE_PAGES), os.sysconf("SC_PAGE_SIZE")
    return max(2.0, min(0.75 * pages * size / 2**30, 3.0 * DEFAULT_JOBS))
