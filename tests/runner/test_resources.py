"""Budget of cores, memory, GPUs and disk space; GPUs are found without torch."""

from __future__ import annotations

import os
import stat
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from runner.modules import Modules
from runner.resources import Budget, Grant, Resources, find_gpus, resources_of
from runner.selection import declarations

TRAINING = Resources(threads=2, gpus=1)
SHARED = Resources(gpus=1, gpu_shared=True)


def amounts() -> st.SearchStrategy[Resources]:
    return st.builds(Resources, st.integers(1, 3), st.sampled_from([0.0, 0.1, 1.5, 4.0]), st.integers(0, 3), st.booleans(),
                     st.just(0.0), st.integers(-1, 3))


@given(st.lists(amounts(), max_size=30), st.lists(st.integers(0, 9), max_size=30), st.integers(0, 3))
def test_running_tasks_stay_within_the_budget(tasks: list[Resources], ends: list[int], gpus: int) -> None:
    """Cores and memory are not exceeded, unless a task runs alone; a GPU has one task, or tasks that share it."""
    budget, running = Budget(4, 4.0, [str(n) for n in range(gpus)]), list[Grant]()
    for at, task in enumerate(tasks):
        for _ in range(ends[at] if at < len(ends) else 0):
            budget.give(running.pop(0)) if running else None
        if budget.fits(task):
            running.append(budget.take(task))
        assert len(running) == 1 or sum(one.resources.threads for one in running) <= 4
        assert len(running) == 1 or sum(one.resources.memory_gib for one in running) <= 4.001
        for gpu in budget.gpus:
            users = [one.resources for one in running if gpu in one.held]
            assert len(users) <= 1 or all(user.gpu_shared for user in users)
    for grant in running:
        budget.give(grant)
    assert all(budget.fits(task) for task in tasks), "everything was given back"


def test_two_trainings_never_share_a_gpu_unless_they_say_so() -> None:
    """Each gets a GPU of its own, and the third waits; tasks that share are spread over the free GPUs."""
    budget = Budget(16, 64.0, ["0", "GPU-7"])
    first, second = budget.take(TRAINING), budget.take(TRAINING)
    assert {first.visible, second.visible} == {("0",), ("GPU-7",)} and not budget.fits(TRAINING) and not budget.fits(SHARED)
    budget.give(second)
    several = [budget.take(SHARED) for _ in range(3)]
    assert {one.visible for one in several} == {second.visible} and budget.fits(SHARED) and not budget.fits(TRAINING)
    budget.give(first)
    assert budget.take(SHARED).visible == first.visible, "the GPU with the fewest tasks"


def test_a_task_may_name_its_gpu() -> None:
    """`cuda:1` holds the second GPU alone, and sees all so that the number means the same."""
    budget = Budget(16, 64.0, ["4", "5", "6"])
    named = Resources(gpus=1, gpu_index=1)
    grant = budget.take(named)
    assert grant.held == ("5",) and grant.visible == ("4", "5", "6") and not budget.fits(named)
    assert sorted(budget.take(TRAINING).held + budget.take(TRAINING).held) == ["4", "6"]


def test_one_gpu_is_assumed_without_a_driver() -> None:
    """Tasks for a GPU run one after another in an unchanged environment, beside tasks without."""
    budget = Budget(16, 64.0, [])
    grant = budget.take(Resources(gpus=2))
    assert grant.visible == () and not budget.fits(TRAINING) and budget.fits(Resources())
    budget.give(grant)
    assert budget.fits(TRAINING)


def test_scratch_space_is_compared_with_the_free_disk_space(tmp_path: Path) -> None:
    """Space granted to running tasks counts; a task that runs alone starts in any case."""
    found = os.statvfs(tmp_path)
    free = found.f_bavail * found.f_frsize / 2**30
    budget, half = Budget(16, 64.0, [], tmp_path), Resources(scratch_gib=0.6 * free)
    assert budget.fits(Resources(scratch_gib=10 * free))
    grant = budget.take(half)
    assert not budget.fits(half) and budget.fits(Resources())
    budget.give(grant)
    other = budget.take(Resources())
    assert budget.fits(half)
    budget.give(other)


def test_gpus_are_found_by_the_variable_then_by_the_driver(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """CUDA counts them in this way; `nvidia-smi` is the last resort, and its absence means none."""
    assert find_gpus({"CUDA_VISIBLE_DEVICES": "2, GPU-a,-1,3"}) == ("2", "GPU-a")
    assert find_gpus({"CUDA_VISIBLE_DEVICES": ""}) == ()
    for name in ("0000:01:00.0", "0000:02:00.0"):
        (tmp_path / "gpus" / name).mkdir(parents=True)
        (tmp_path / "gpus" / name / "information").write_text("Model: some GPU\n")
    assert find_gpus({}, tmp_path / "gpus") == ("0", "1")
    monkeypatch.setenv("PATH", str(tmp_path))
    assert find_gpus({}, tmp_path / "none") == ()
    program = tmp_path / "nvidia-smi"
    program.write_text(f"#!{sys.executable}\nprint('GPU 0: A (UUID: GPU-x)\\n  MIG 1g: (UUID: y)\\nGPU 1: A (UUID: GPU-z)')\n")
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    assert find_gpus({}, tmp_path / "none") == ("0", "1")
    program.write_text(f"#!{sys.executable}\nraise SystemExit('no driver')\n")
    assert find_gpus({}, tmp_path / "none") == ()


@dataclass(frozen=True)
class Block:
    device: str = "cpu"


@dataclass(frozen=True)
class Params:
    backend: str = "a"
    device: str = "cpu"
    devices: int = 1
    b: Block = Block()


STAGE = """
BACKENDS = {"a": "m:f", "b": "m:f"}
MEMORY_GIB = 2
SCRATCH_GIB = 3
BACKEND_GPUS = {"b": "b.device"}
def run(x=3):
    return BACKENDS
"""


@pytest.mark.parametrize(("gpus", "params", "count", "index"), [
    ("0", Params(device="cuda"), 0, -1), ("2", Params(), 2, -1), ("'device'", Params(), 0, -1),
    ("'device'", Params(device="cuda"), 1, -1), ("'device'", Params(device="cuda:1"), 1, 1),
    ("('device', 'devices')", Params(device="cuda", devices=4), 4, -1), ("('device', 'devices')", Params(devices=4), 0, -1),
    ("'device'", Params("b", b=Block("cuda")), 1, -1), ("0", Params("a", b=Block("cuda")), 0, -1)])
def test_gpus_follow_a_parameter(gpus: str, params: Params, count: int, index: int, tmp_path: Path) -> None:
    """The field of the selected backend counts."""
    (tmp_path / "stage.py").write_text(STAGE + f"GPUS = {gpus}\n")
    (tmp_path / "m.py").write_text("def f():\n    return 1\n")
    declared = declarations(Modules(tmp_path), "stage", {"backend": params.backend})
    assert resources_of(declared, params) == Resources(1, 2.0, count, False, 3.0, index)


def test_a_parameter_that_is_not_there_is_refused(tmp_path: Path) -> None:
    """The message says which."""
    (tmp_path / "stage.py").write_text("GPUS = 'b.devise'\ndef run():\n    return 1\n")
    with pytest.raises(ValueError, match=r"GPUS names 'b\.devise', which is no field of Params; correct the name"):
        resources_of(declarations(Modules(tmp_path), "stage", {}), Params())
    assert resources_of(declarations(Modules(tmp_path), "stage", {}), Params(), {"b"}) == Resources(1, 1.0)
