"""Laws of the training loop: a kill changes nothing, parts of a batch are the batch, the same seed gives the same bytes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from torch import nn

from afford.training import loop
from afford.training.loop import (
    SINGLE_PROCESS,
    accumulate_gradients,
    autocast,
    deterministic,
    parallel_gradients,
    prefetch,
    train,
    warmup_decay,
)
from afford.training.state import load_checkpoint
from afford.training.train import train_job
from schemas.files import FileTree
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
    with deterministic(1, "cpu"):
        yield


@pytest.mark.parametrize("kill", [1, 5, 6, 13, 23])
def test_resumed_training_is_an_uninterrupted_one(tmp_path: Path, kill: int, monkeypatch) -> None:
    """Killed after any step, before or after a checkpoint, it ends with the same weights, curves and files (events too)."""
    monkeypatch.setattr("afford.training.loop.SAVE_EVERY", 4)
    whole, state = run(tmp_path / "whole")
    with pytest.raises(KilledError):
        run(tmp_path / "killed", until=kill)
    resumed, again = run(tmp_path / "killed")
    assert bytes_of(resumed.model) == bytes_of(whole.model)
    assert again.points == state.points and again.best_step == state.best_step
    names = sorted(path.relative_to(tmp_path / "whole") for path in (tmp_path / "whole").rglob("*") if path.is_file())
    assert {"checkpoint.safetensors", "previews", "tensorboard"} == {name.parts[0] for name in names}
    assert all((tmp_path / "killed" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes() for name in names)


def test_process_killed_by_a_signal_resumes(tmp_path: Path) -> None:
    """The same with kill -9 in the middle of a step."""
    code = ("import sys, pathlib, os, signal\nfrom afford.training.loop import train\nfrom afford.training import loop\n"
            "from tests.helpers.toy_training import *\nloop.SAVE_EVERY = 3\n"
            "def progress(done, total):\n    if done == int(sys.argv[2]): os.kill(os.getpid(), signal.SIGKILL)\n"
            "train(Toy(), PLAN, pathlib.Path(sys.argv[1]), progress)")
    killed = subprocess.run([sys.executable, "-c", code, str(tmp_path), "17"], cwd=ROOT, env={**os.environ, "OMP_NUM_THREADS": "1"})
    assert killed.returncode == -signal.SIGKILL
    resumed, _ = run(tmp_path)
    whole, _ = run(tmp_path / "whole")
    assert bytes_of(resumed.model) == bytes_of(whole.model)


def test_checkpoints_append_to_the_event_file(tmp_path: Path, monkeypatch) -> None:
    """The file of one process is never replaced: each checkpoint keeps its first bytes and its inode."""
    monkeypatch.setattr("afford.training.loop.SAVE_EVERY", 4)
    seen = [(b"", 0)]

    def progress(done: int, total: int) -> None:
        (file,) = (tmp_path / "tensorboard").iterdir()
        data, inode = file.read_bytes(), file.stat().st_ino
        assert data.startswith(seen[-1][0]) and inode == (seen[-1][1] or inode)
        seen.append((data, inode))

    train(Toy(), PLAN, tmp_path, progress)
    assert len({data for data, _ in seen[1:]}) == 10  # empty; after steps 4, 5, 8, 10, 12, 15, 16, 20 and 24


def test_finished_training_only_restores_its_weights(tmp_path: Path) -> None:
    """Started again in its folder, it trains no more, also after an early stop."""
    plan = replace(PLAN, lr=0.0, patience=2)
    first, state = run(tmp_path, plan)
    assert state.stopped and state.step == 15 and state.best_step == 5
    second, again = run(tmp_path, plan, until=1)
    assert bytes_of(second.model) == bytes_of(first.model) and again.step == 15


def test_accumulated_micro_batches_are_one_batch(tmp_path: Path) -> None:
    """Four micro-batches of two samples move the weights as one batch of eight."""
    whole, _ = run(tmp_path / "a", task=Toy(8, dropout=0, norm=False))
    parts, _ = run(tmp_path / "b", replace(PLAN, accumulate=4), Toy(2, dropout=0, norm=False))
    for a, b in zip(whole.model.parameters(), parts.model.parameters(), strict=True):
        torch.testing.assert_close(a, b, rtol=1e-4, atol=1e-5)


def test_prefetching_threads_change_nothing(tmp_path: Path) -> None:
    """No thread, one, three: the same weights. Another seed: others."""
    made = [bytes_of(run(tmp_path / str(n), replace(PLAN, workers=n))[0].model) for n in (0, 1, 3)]
    assert made[0] == made[1] == made[2]
    assert bytes_of(run(tmp_path / "other", replace(PLAN, seed=4))[0].model) != made[0]


def test_best_weights_are_restored(tmp_path: Path) -> None:
    """The model ends with the weights of the best validation, not the last ones; of equals, the earliest."""
    task, seen = Toy(), []

    def validate() -> dict[str, float]:
        seen.append(bytes_of(task.model))
        return {"fit": (0.1, 0.7, 0.7, 0.2, 0.3)[len(seen) - 1]}

    task.validate = validate
    task.preview = lambda folder, step: None
    _, state = run(tmp_path, task=task)
    assert state.best_step == 10 and bytes_of(task.model) == seen[1] != seen[4]


def test_warmup_decay_values() -> None:
    """4 steps up, 6 equal steps down, by hand; it never reaches zero within the training."""
    found = [warmup_decay(step, 4, 10) for step in range(11)]
    assert found == pytest.approx([0.25, 0.5, 0.75, 1, 1, 5 / 6, 4 / 6, 3 / 6, 2 / 6, 1 / 6, 0])
    assert [warmup_decay(step, 4, 10, decay=False) for step in (0, 3, 4, 9)] == [0.25, 1, 1, 1]


def test_frozen_weights_are_neither_moved_nor_saved(tmp_path: Path) -> None:
    task = Toy()
    task.model[0].requires_grad_(False)
    before = task.model[0].weight.clone()
    run(tmp_path, task=task)
    assert torch.equal(task.model[0].weight, before)
    tensors, metadata = load_checkpoint(tmp_path / "checkpoint.safetensors")
    assert not any(name.startswith(("now/0.", "best/0.")) for name in tensors) and metadata["step"] == PLAN.steps


def test_infinite_loss_is_an_error(tmp_path: Path) -> None:
    """The error names the step; the checkpoint stays finite."""
    task = Toy()
    task.batch = lambda number: (torch.full((4, 6), float("nan") if number > 6 else 0.0), torch.zeros(4, 1))
    with pytest.raises(FloatingPointError, match="step 8: the loss total is nan"):
        run(tmp_path, task=task)
    tensors, _ = load_checkpoint(tmp_path / "checkpoint.safetensors")
    assert all(torch.isfinite(tensor).all() for tensor in tensors.values())


def test_damaged_checkpoint_is_refused(tmp_path: Path) -> None:
    """Half a file, one flipped bit of a weight or a changed name is an error; the next run trains from the beginning."""
    first, _ = run(tmp_path)
    path = tmp_path / "checkpoint.safetensors"
    whole = path.read_bytes()
    for damaged in (whole[:500], whole[:-5] + bytes([whole[-5] ^ 1]) + whole[-4:], whole.replace(b"step", b"stop", 1)):
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match=r"checkpoint\.safetensors: the checkpoint is damaged"):
            run(tmp_path)
        again, _ = run(tmp_path)
        assert bytes_of(again.model) == bytes_of(first.model)


def test_prefetch_keeps_the_order_and_raises_where_an_item_is_due() -> None:
    assert list(prefetch(lambda n: n * n, range(20), 3)) == [n * n for n in range(20)]
    with pytest.raises(ZeroDivisionError):
        list(prefetch(lambda n: 1 // (5 - n), range(9), 2))


def convolutions() -> nn.Sequential:
    torch.manual_seed(0)
    return nn.Sequential(nn.Conv2d(3, 8, 3), nn.ReLU(), nn.Conv2d(8, 8, 3), nn.Flatten(), nn.Linear(8 * 16, 5))


@pytest.mark.parametrize("parts", [1, 2, 3])
def test_parallel_gradients_are_accumulated_gradients(parts: int) -> None:
    """The same gradients to the bit and the same scalars, whatever the number of threads; an unused parameter gets none."""
    batches = [torch.randn(4, 3, 8, 8, generator=torch.Generator().manual_seed(n)) for n in range(parts)]
    found = []
    for threads in (0, 1, 2, 3):
        model = convolutions()
        model.append(nn.Identity()).register_parameter("unused", nn.Parameter(torch.ones(2)))

        def loss(batch: torch.Tensor, model: nn.Module = model) -> dict[str, torch.Tensor]:
            return {"total": model(batch).square().mean()}

        if threads:
            scalars = parallel_gradients(loss, batches, model, threads)
        else:
            scalars = accumulate_gradients(loss, batches, model, SINGLE_PROCESS)
        assert model.get_parameter("unused").grad is None
        found.append([each["total"].item() for each in scalars] + [p.grad.numpy().tobytes() for p in model[:5].parameters()])
    assert found[0] == found[1] == found[2] == found[3]


def test_gradients_have_the_memory_layout_of_their_parameters() -> None:
    """Inputs with channels last too: a fused optimizer walks through both in memory order, so its steps are the same."""
    seeded = (torch.Generator().manual_seed(n) for n in range(2))
    batches = [torch.randn(4, 3, 8, 8, generator=g).contiguous(memory_format=torch.channels_last) for g in seeded]
    made = []
    for threads in (0, 2):
        model = convolutions()
        optimizer = torch.optim.AdamW(model.parameters(), 0.1, fused=True)
        for _ in range(3):
            optimizer.zero_grad(set_to_none=True)

            def loss(batch: torch.Tensor, model: nn.Module = model) -> dict[str, torch.Tensor]:
                return {"total": model(batch).square().mean()}

            if threads:
                parallel_gradients(loss, batches, model, threads)
            else:
                accumulate_gradients(loss, batches, model, SINGLE_PROCESS)
            assert all(p.grad is not None and p.grad.stride() == p.stride() for p in model.parameters())
            optimizer.step()
        made.append(b"".join(p.detach().numpy().tobytes() for p in model.parameters()))
    assert made[0] == made[1]


def test_error_in_a_thread_is_the_error_of_the_step() -> None:
    def loss(batch: int) -> dict[str, torch.Tensor]:
        raise ZeroDivisionError(str(batch))

    with pytest.raises(ZeroDivisionError, match="4"):
        parallel_gradients(loss, [4, 5], convolutions(), 2)


@pytest.mark.parametrize(("found", "wanted", "kind"), [
    ({"amx_bf16": True}, True, torch.bfloat16), ({"avx512_bf16": True, "amx_bf16": False}, True, torch.bfloat16),
    ({"bf16": True}, True, torch.bfloat16), ({"avx512_f": True, "avx512_bf16": False}, True, torch.float32),
    ({}, True, torch.float32), ({"amx_bf16": True}, False, torch.float32),
])  # fmt: skip
def test_autocast_needs_bfloat16_instructions(found: dict[str, bool], wanted: bool, kind: torch.dtype,
                                              monkeypatch: pytest.MonkeyPatch) -> None:  # fmt: skip
    """A product has type bfloat16 on a CPU with such instructions when it is wanted, single precision otherwise."""
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: found)
    with autocast("cpu", wanted):
        assert (torch.ones(2, 2) @ torch.ones(2, 2)).dtype == kind


@pytest.mark.slow
def test_two_processes_train_as_one(tmp_path: Path) -> None:
    """Two gloo processes of the standard launcher with half the batch each move the weights as one process with all of it.

    Killed and launched again, they end with the same bytes.
    """
    code = ("import sys, pathlib, os\nfrom dataclasses import replace\nfrom afford.training import loop, distributed\n"
            "from tests.helpers.toy_training import *\nloop.SAVE_EVERY = 4\nfolder = pathlib.Path(sys.argv[1])\n"
            "def progress(done, total):\n    if done == int(sys.argv[2]): os._exit(1)\n"
            "with distributed.process_group('cpu') as group:\n    task = Toy(4, 0, False)\n"
            "    loop.train(task, replace(PLAN, validate_every=0), folder, progress, group)\n"
            "    (folder / f'{group.rank}.bin').write_bytes(bytes_of(task.model))\n")
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


@pytest.mark.parametrize(("device", "wanted"), [("cpu", False), ("cuda", True), ("cuda:1", True)])
def test_deterministic_algorithms_on_every_gpu(device: str, wanted: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A GPU that is named by its number is one."""
    found = []

    def fit(*_: object) -> None:
        found.append(torch.are_deterministic_algorithms_enabled())
        raise KilledError

    monkeypatch.setattr(loop, "fit", fit)
    monkeypatch.setenv("CUBLAS_WORKSPACE_CONFIG", ":4096:8")
    job = SimpleNamespace(plan=replace(PLAN, device=device), prepare=lambda files, scratch: None)
    with pytest.raises(KilledError):
        train_job(job, FileTree("none", ()), "toy", SimpleNamespace(scratch=tmp_path, progress=print), 1)
    assert found == [wanted] and not torch.are_deterministic_algorithms_enabled()


def test_several_devices_are_not_one_numbered_gpu(tmp_path: Path) -> None:
    """Two processes on `cuda:1` would share it; refused before anything is prepared."""
    job = SimpleNamespace(plan=replace(PLAN, device="cuda:1"))
    with pytest.raises(ValueError, match=r"expected cpu or cuda for a training on 2 devices, got 'cuda:1', which is one GPU"):
        train_job(job, FileTree("none", ()), "toy", SimpleNamespace(scratch=tmp_path, progress=print), 1, devices=2)
