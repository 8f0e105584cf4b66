"""Laws of the training loop: it can be killed anywhere, parts of a batch are the batch, the same seed gives the same bytes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from afford.training import checkpoint
from afford.training.ahead import ahead
from afford.training.loop import train
from afford.training.schedule import warmup_decay
from tests.helpers.toy_training import PLAN, Toy, bytes_of

ROOT = Path(__file__).resolve().parents[2]


class KilledError(Exception):
    """Stands for the end of the process."""


def run(folder: Path, plan=PLAN, task=None, until: int = 10**9):
    task = task or Toy()

    def progress(done: int, total: int) -> None:
        if done == until:
            raise KilledError

    folder.mkdir(exist_ok=True)
    return task, train(task, plan, folder, progress)


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """Bytes are promised for one number of threads; processes that a test starts have one."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.mark.parametrize("kill", [1, 5, 6, 13, 23])
def test_resumed_is_uninterrupted(tmp_path: Path, kill: int, monkeypatch) -> None:
    """Killed after any step, before or after a checkpoint, it ends with the same weights, curves and files."""
    monkeypatch.setattr("afford.training.loop.SAVE_EVERY", 4)
    whole, state = run(tmp_path / "whole")
    with pytest.raises(KilledError):
        run(tmp_path / "killed", until=kill)
    resumed, again = run(tmp_path / "killed")
    assert bytes_of(resumed.model) == bytes_of(whole.model)
    assert again.points == state.points and again.best_step == state.best_step
    names = sorted(path.relative_to(tmp_path / "whole") for path in (tmp_path / "whole").rglob("*") if path.is_file())
    assert all((tmp_path / "killed" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes() for name in names)


def test_a_killed_process_goes_on(tmp_path: Path) -> None:
    """The same with kill -9 in the middle of the work."""
    code = ("import sys, pathlib, os, signal\nfrom afford.training.loop import train\nfrom afford.training import loop\n"
            "from tests.helpers.toy_training import *\nloop.SAVE_EVERY = 3\n"
            "def progress(done, total):\n    if done == int(sys.argv[2]): os.kill(os.getpid(), signal.SIGKILL)\n"
            "train(Toy(), PLAN, pathlib.Path(sys.argv[1]), progress)")
    killed = subprocess.run([sys.executable, "-c", code, str(tmp_path), "17"], cwd=ROOT, env={**os.environ, "OMP_NUM_THREADS": "1"})
    assert killed.returncode == -signal.SIGKILL
    resumed, _ = run(tmp_path)
    whole, _ = run(tmp_path / "whole")
    assert bytes_of(resumed.model) == bytes_of(whole.model)


def test_a_finished_training_trains_no_more(tmp_path: Path) -> None:
    """Started again in its folder, it only gives the weights again, also after an early stop."""
    plan = replace(PLAN, lr=0.0, patience=2)
    first, state = run(tmp_path, plan)
    assert state.stopped and state.step == 15 and state.best_step == 5
    second, again = run(tmp_path, plan, until=1)
    assert bytes_of(second.model) == bytes_of(first.model) and again.step == 15


def test_parts_of_a_batch_are_the_batch(tmp_path: Path) -> None:
    """Four micro-batches of two samples move the weights as one batch of eight."""
    whole, _ = run(tmp_path / "a", task=Toy(8, dropout=0, norm=False))
    parts, _ = run(tmp_path / "b", replace(PLAN, accumulate=4), Toy(2, dropout=0, norm=False))
    for a, b in zip(whole.model.parameters(), parts.model.parameters(), strict=True):
        torch.testing.assert_close(a, b, rtol=1e-4, atol=1e-5)


def test_threads_that_make_batches_change_nothing(tmp_path: Path) -> None:
    """No thread, one, three: the same weights. Another seed: others."""
    made = [bytes_of(run(tmp_path / str(n), replace(PLAN, workers=n))[0].model) for n in (0, 1, 3)]
    assert made[0] == made[1] == made[2]
    assert bytes_of(run(tmp_path / "other", replace(PLAN, seed=4))[0].model) != made[0]


def test_the_best_weights_are_kept(tmp_path: Path) -> None:
    """What stays in the model is what validated best, not what came last; of equals, the earliest."""
    task, seen = Toy(), []

    def validate() -> dict[str, float]:
        seen.append(bytes_of(task.model))
        return {"fit": (0.1, 0.7, 0.7, 0.2, 0.3)[len(seen) - 1]}

    task.validate = validate
    task.preview = lambda folder, step: None
    _, state = run(tmp_path, task=task)
    assert state.best_step == 10 and bytes_of(task.model) == seen[1] != seen[4]


def test_schedule_values() -> None:
    """By hand: 4 steps up, 6 equal steps down; it never reaches zero within the training."""
    found = [warmup_decay(step, 4, 10) for step in range(11)]
    assert found == pytest.approx([0.25, 0.5, 0.75, 1, 1, 5 / 6, 4 / 6, 3 / 6, 2 / 6, 1 / 6, 0])
    assert [warmup_decay(step, 4, 10, decay=False) for step in (0, 3, 4, 9)] == [0.25, 1, 1, 1]


def test_a_frozen_part_stays(tmp_path: Path) -> None:
    """What does not require a gradient is neither moved nor saved."""
    task = Toy()
    task.model[0].requires_grad_(False)
    before = task.model[0].weight.clone()
    run(tmp_path, task=task)
    assert torch.equal(task.model[0].weight, before)
    tensors, words = checkpoint.load(tmp_path / "checkpoint.safetensors")
    assert not any(name.startswith(("now/0.", "best/0.")) for name in tensors) and words["step"] == PLAN.steps


def test_a_loss_that_explodes_is_an_error(tmp_path: Path) -> None:
    """Not a number in, a sentence with the step out; nothing of it is saved."""
    task = Toy()
    task.batch = lambda number: (torch.full((4, 6), float("nan") if number > 6 else 0.0), torch.zeros(4, 1))
    with pytest.raises(FloatingPointError, match="step 8: the loss total is nan"):
        run(tmp_path, task=task)
    tensors, _ = checkpoint.load(tmp_path / "checkpoint.safetensors")
    assert all(torch.isfinite(tensor).all() for tensor in tensors.values())


def test_a_damaged_checkpoint_is_refused(tmp_path: Path) -> None:
    """Half a file, or one flipped bit of a weight, is named, not loaded; the next run begins anew and ends as a first one does."""
    first, _ = run(tmp_path)
    path = tmp_path / "checkpoint.safetensors"
    whole = path.read_bytes()
    for damaged in (whole[:500], whole[:-5] + bytes([whole[-5] ^ 1]) + whole[-4:], whole.replace(b"step", b"stop", 1)):
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match=r"checkpoint\.safetensors: expected a checkpoint of a training"):
            run(tmp_path)
        again, _ = run(tmp_path)
        assert bytes_of(again.model) == bytes_of(first.model)


def test_ahead_keeps_the_order_and_passes_errors_on() -> None:
    """Whoever is quicker; an error appears where its batch is due."""
    assert list(ahead(lambda n: n * n, range(20), 3)) == [n * n for n in range(20)]
    with pytest.raises(ZeroDivisionError):
        list(ahead(lambda n: 1 // (5 - n), range(9), 2))


@pytest.mark.slow
def test_two_processes_are_one(tmp_path: Path) -> None:
    """Two gloo processes of the standard launcher with half the batch each move the weights as one process with all of it;
    killed and launched again, they end with the same bytes.
    """
    code = ("import sys, pathlib, os\nfrom dataclasses import replace\nfrom afford.training import loop, ranks\n"
            "from tests.helpers.toy_training import *\nloop.SAVE_EVERY = 4\nfolder = pathlib.Path(sys.argv[1])\n"
            "def progress(done, total):\n    if done == int(sys.argv[2]): os._exit(1)\n"
            "with ranks.launched('cpu') as r:\n    task = Toy(4, 0, False)\n"
            "    loop.train(task, replace(PLAN, validate_every=0), folder, progress, r)\n"
            "    (folder / f'{r.rank}.bin').write_bytes(bytes_of(task.model))\n")
    script = tmp_path / "script.py"
    script.write_text(code)
    env = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
    for name, kills in (("a", [0]), ("b", [10, 0])):
        (tmp_path / name).mkdir()
        for kill in kills:
            command = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2", str(script),
                       str(tmp_path / name), str(kill)]
            done = subprocess.run(command, cwd=tmp_path, env=env, capture_output=True, text=True)
            assert (done.returncode == 0) == (kill == 0), done.stderr[-2000:]
    one, _ = run(tmp_path / "one", replace(PLAN, validate_every=0), Toy(8, 0, False))
    made = np.frombuffer((tmp_path / "a" / "0.bin").read_bytes(), np.float32)
    np.testing.assert_allclose(made, np.frombuffer(bytes_of(one.model), np.float32), rtol=1e-4, atol=1e-5)
    assert (tmp_path / "a" / "0.bin").read_bytes() == (tmp_path / "b" / "0.bin").read_bytes()
