"""Resources of tasks, and the budget of one machine: cores, memory, GPUs, disk space.

A task declares what it needs (`runner.selection`); the budget grants it when it fits beside the running tasks. When nothing runs,
any task fits, however much it needs, so that no run waits for ever.

A GPU belongs to one task at a time, except for tasks that declare GPU_SHARED: these share GPUs among themselves, and each starts on
the one with the fewest tasks. Two trainings therefore never share a GPU by accident. Where no NVIDIA GPU is found, one unnamed GPU
is assumed: tasks that want one run one after another in an unchanged environment (a GPU of another make), and a stage that finds
none fails with its own error. The same holds for a task that wants more GPUs than there are.

Disk space is compared with the free space when a task starts, less the space granted to running tasks.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

PROC_GPUS = Path("/proc/driver/nvidia/gpus")
VISIBLE = "CUDA_VISIBLE_DEVICES"
"""environment variable that restricts a process to some GPUs, and numbers them"""
UNNAMED = ""
"""GPU that is assumed where none is found"""
QUERY_TIMEOUT_S = 20.0
ROUNDING = 1e-6
"""GiB by which sums of declared memory may exceed the limit"""


@dataclass(frozen=True)
class Resources:
    """Resources of one task."""

    threads: int = 1
    memory_gib: float = 0.0
    gpus: int = 0
    gpu_shared: bool = False
    scratch_gib: float = 0.0
    gpu_index: int = -1
    """number of the only GPU that the task accepts, for a parameter such as "cuda:1"; -1 for any"""


@dataclass(frozen=True)
class Grant:
    """Resources that a task holds."""

    resources: Resources
    held: tuple[str, ...] = ()
    """GPUs that the task uses"""
    visible: tuple[str, ...] = ()
    """GPUs for the environment of its process, in their order; empty: unchanged"""


class Budget:
    """Cores, memory, GPUs and disk space that tasks may use at the same time.

    `gpus`: names or numbers as in CUDA_VISIBLE_DEVICES; None: those that `find_gpus` finds, when a task first wants one.
    `scratch`: folder whose free space limits SCRATCH_GIB; None for no limit.
    """

    def __init__(self, jobs: int, memory_gib: float, gpus: Sequence[str] | None = None, scratch: Path | None = None) -> None:
        self.jobs, self.memory_gib = jobs, memory_gib
        self._gpus = None if gpus is None else tuple(gpus) or (UNNAMED,)
        self._scratch = scratch
        self._tasks, self._threads, self._memory_gib, self._scratch_gib = 0, 0, 0.0, 0.0
        self._users: dict[str, int] = {}
        """GPU in use -> number of its tasks"""
        self._exclusive: set[str] = set()

    def fits(self, resources: Resources) -> bool:
        """Return True when the task can start now; always when nothing runs."""
        if not self._tasks:
            return True
        memory_gib = self._memory_gib + resources.memory_gib
        return (self._threads + resources.threads <= self.jobs and memory_gib <= self.memory_gib + ROUNDING
                and (not resources.gpus or self._free_gpus(resources) is not None)
                and (not resources.scratch_gib or resources.scratch_gib <= self._free_gib()))

    def take(self, resources: Resources) -> Grant:
        """Grant what `fits` has found to fit."""
        held = (self._free_gpus(resources) or ()) if resources.gpus else ()
        self._add(resources, 1)
        for gpu in held:
            self._users[gpu] = self._users.get(gpu, 0) + 1
        if not resources.gpu_shared:
            self._exclusive.update(held)
        return Grant(resources, held, self._visible(resources, held))

    def give(self, grant: Grant) -> None:
        """Take back what a finished task held."""
        self._add(grant.resources, -1)
        for gpu in grant.held:
            self._users[gpu] -= 1
            if not self._users[gpu]:
                del self._users[gpu]
                self._exclusive.discard(gpu)

    def _add(self, resources: Resources, sign: int) -> None:
        self._tasks += sign
        self._threads += sign * resources.threads
        self._memory_gib += sign * resources.memory_gib
        self._scratch_gib += sign * resources.scratch_gib
        if not self._tasks:  # no rounding error outlives the last task
            self._memory_gib = self._scratch_gib = 0.0

    @property
    def gpus(self) -> tuple[str, ...]:
        """GPUs of the budget; one unnamed GPU where none was found."""
        if self._gpus is None:
            self._gpus = find_gpus() or (UNNAMED,)
        return self._gpus

    def _free_gpus(self, resources: Resources) -> tuple[str, ...] | None:
        """GPUs for a task, those with the fewest tasks first; None while too few are free."""
        known = self.gpus
        if resources.gpu_index >= 0:
            known = known[resources.gpu_index : resources.gpu_index + 1] or known[:1]
        free = [gpu for gpu in known if gpu not in self._users or (resources.gpu_shared and gpu not in self._exclusive)]
        count = min(resources.gpus, len(known))
        return tuple(sorted(free, key=lambda gpu: self._users.get(gpu, 0))[:count]) if len(free) >= count else None

    def _visible(self, resources: Resources, held: tuple[str, ...]) -> tuple[str, ...]:
        """GPUs that the process of a task may see: its own; all for a task that names one by its number, and keeps it."""
        if UNNAMED in held:
            return ()
        return self.gpus if resources.gpu_index >= 0 else held

    def _free_gib(self) -> float:
        if self._scratch is None:
            return float("inf")
        found = os.statvfs(self._scratch)
        return found.f_bavail * found.f_frsize / 2**30 - self._scratch_gib


def resources_of(declared: Mapping[str, Any], params: Any, blocks: Collection[str] = ()) -> Resources:
    """Resources of a stage from its `declarations` and its Params; `blocks` are the fields of unselected backends.

    ValueError when GPUS names a field that Params lacks.
    """
    wanted = [_gpus(value, params) for value in declared["GPUS"] if isinstance(value, int) or _first(value) not in blocks]
    gpus, index = max(wanted, default=(0, -1))
    return Resources(declared["THREADS"], declared["MEMORY_GIB"], gpus, declared["GPU_SHARED"], declared["SCRATCH_GIB"], index)


def _first(value: str | list[str]) -> str:
    return (value if isinstance(value, str) else value[0]).partition(".")[0]


def _gpus(value: int | str | list[str], params: Any) -> tuple[int, int]:
    """(number of GPUs, number of the only GPU or -1) of one entry of GPUS."""
    if isinstance(value, int):
        return value, -1
    named, counted = (value, "") if isinstance(value, str) else value
    kind, _, index = str(_field(params, named)).partition(":")
    if kind != "cuda":
        return 0, -1
    count = int(_field(params, counted)) if counted else 1
    return count, int(index) if index.isdigit() and count == 1 else -1


def _field(params: Any, name: str) -> Any:
    value = params
    for part in name.split("."):
        if not hasattr(value, part):
            raise ValueError(f"GPUS names {name!r}, which is no field of Params; correct the name")
        value = getattr(value, part)
    return value


def find_gpus(environment: Mapping[str, str] = os.environ, folder: Path = PROC_GPUS) -> tuple[str, ...]:
    """GPUs that this process may use, as CUDA numbers or names them; none where there is no NVIDIA driver.

    CUDA_VISIBLE_DEVICES counts first, then the list of the kernel module, then `nvidia-smi -L`. torch is not imported.
    """
    if VISIBLE in environment:
        names = [name.strip() for name in environment[VISIBLE].split(",")]
        end = next((at for at, name in enumerate(names) if not name or name.startswith("-")), len(names))  # CUDA stops there, too
        return tuple(names[:end])
    count = len(list(folder.glob("*/information"))) if folder.is_dir() else _queried()
    return tuple(str(number) for number in range(count))


def _queried() -> int:
    """Number of GPUs that nvidia-smi lists; 0 without the program, or when it finds no driver."""
    import shutil  # only where there may be a GPU without a list of the kernel module (WSL)
    import subprocess

    program = shutil.which("nvidia-smi")
    if program is None:
        return 0
    try:
        found = subprocess.run([program, "-L"], capture_output=True, text=True, timeout=QUERY_TIMEOUT_S, check=False)
    except subprocess.TimeoutExpired:
        raise OSError(f"`{program} -L` gave no answer in {QUERY_TIMEOUT_S:.0f} s; set {VISIBLE} to the GPUs to use") from None
    return sum(line.startswith("GPU ") for line in found.stdout.splitlines()) if found.returncode == 0 else 0
