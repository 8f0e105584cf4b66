"""Memory plans: what they count, that the planned run is the real one, and the sentences that refuse."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor, nn
from torch.utils.checkpoint import checkpoint

from afford.models.meta_memory import model_tensors, peak_bytes, recomputed, tensor_bytes
from afford.twohands.model import memory_plan
from afford.twohands.model.frozen_weights import store_frozen
from afford.twohands.model.interface import Batch, Target, TwoHands, build
from afford.twohands.model.large import plan_folder
from afford.twohands.model.losses import LossParams, losses
from afford.twohands.model.memory_plan import GIB, MemoryPlan, make_room
from afford.twohands.model.model_folder import load_model, read_config, save_model
from afford.twohands.train import memory_plan as training
from afford.twohands.train.job import TwoHandsJob
from afford.twohands.train.memory_plan import check_training, plan_training
from commands.errors import UsageError
from commands.weights_plan import plan
from stages.twohands import model_train
from tests.helpers.large_models import write_backbones
from tests.helpers.tiny_models import save_backbones
from tests.twohands.test_vlm_model import config

KIB = 1024


@pytest.fixture(scope="module")
def backbones(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_backbones(tmp_path_factory.mktemp("backbones"))


@pytest.fixture(scope="module")
def saved(backbones: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("saved") / "model"
    save_model(build(config(backbones, hypotheses=1), 0).to(torch.bfloat16), folder)
    return folder


def job(folder: Path, **change: object) -> TwoHandsJob:
    params = replace(model_train.VLM, backbones=str(folder), height_px=64, width_px=64, accumulate=1, val_samples=2)
    return model_train.training_job(replace(params, **change))  # type: ignore[arg-type]


def free(monkeypatch: pytest.MonkeyPatch, size: int) -> list[bool]:
    """Pretend that a device has this much memory, and that every model is a large one; the list has an item a setting of malloc."""
    settings: list[bool] = []
    monkeypatch.setattr(memory_plan, "return_freed_blocks", lambda: settings.append(True))
    monkeypatch.setattr(memory_plan, "free_bytes", lambda device: size)
    monkeypatch.setattr(memory_plan, "LARGE", 0)
    return settings


def test_peak_counts_tensors_that_live_at_once() -> None:
    """Three tensors of a KiB one after the other, of which two live at once; known ones and views of them count nothing."""
    weight = torch.empty(256, device="meta")

    def chain() -> Tensor:
        return ((weight.view(16, 16).t() + 1) * 2) - 3

    assert peak_bytes(chain, [weight]) == 2 * KIB
    assert peak_bytes(lambda: [chain(), chain()], [weight]) == 3 * KIB


def test_whole_numbers_stay_real() -> None:
    """A mask decides a shape, and an index that was made on the device meta has its value."""
    weight, mask = torch.empty(8, 4, device="meta"), torch.tensor([True, False] * 4)

    def work() -> None:
        assert weight[mask].shape == (4, 4)
        assert int(torch.arange(5, device=weight.device).to("meta").sum()) == 10

    assert peak_bytes(work, [weight]) > 0


@pytest.mark.parametrize("mixed", [None, torch.bfloat16])
def test_checkpointing_and_mixed_precision_need_less(mixed: torch.dtype | None) -> None:
    """Activations of layers that are computed again are not kept; those of a smaller type are smaller."""
    with torch.device("meta"):
        layers = nn.ModuleList(nn.Sequential(nn.Linear(64, 256), nn.GELU(), nn.Linear(256, 64)) for _ in range(8))

    def run(again: bool) -> Callable[[], None]:
        def work() -> None:
            x = torch.empty(512, 64, device="meta")
            for layer in layers:
                x = checkpoint(layer, x, use_reentrant=False, context_fn=lambda: recomputed(mixed)) if again else layer(x)
            x.sum().backward()
            layers.zero_grad()
        return work

    whole, part = (peak_bytes(run(again), model_tensors(layers), mixed) for again in (False, True))
    assert part < 0.5 * whole
    assert mixed is None or whole < 0.8 * peak_bytes(run(False), model_tensors(layers))


@pytest.mark.parametrize("half", [False, True])
def test_the_planned_run_keeps_what_the_real_run_keeps(backbones: Path, half: bool) -> None:
    """Type and shape of every tensor that is kept for the backward pass, with and without memory."""
    def kept(device: str) -> Counter[tuple[object, ...]]:
        with torch.device(device):
            model = build(config(backbones), 0, pretrained=False).train()
        if half:
            store_frozen(model, torch.bfloat16)
        found: list[Tensor] = []
        images, masks = torch.zeros(2, 3, 64, 64, device=device), torch.zeros(2, 2, 64, 64, device=device)
        target = Target(masks, torch.ones(2, 2, dtype=torch.bool), torch.tensor([2, 1]))

        def work() -> None:
            with torch.autograd.graph.saved_tensors_hooks(lambda one: found.append(one) or one, lambda one: one):
                torch.manual_seed(0)
                losses(model(Batch(images, ("open the jar", "pour tea"))), target, LossParams())

        peak_bytes(work, model_tensors(model))
        return Counter((one.dtype, tuple(one.shape)) for one in found if one.is_floating_point() and one.numel() > 64)

    assert kept("meta") == kept("cpu")


def test_parts_of_a_training(backbones: Path) -> None:
    """Gradients and moments of what is trained alone; each setting lowers its own part."""
    usual = plan_training(job(backbones, checkpointing=False), 8, 2)
    trained = sum(one.numel() for one in build(config(backbones, hypotheses=1), 0).parameters() if one.requires_grad)
    assert (usual.gradients, usual.moments, usual.best) == (4 * trained, 8 * trained, 4 * trained)
    half = plan_training(job(backbones, checkpointing=False, frozen_dtype="bfloat16"), 8, 2)
    assert half.weights < usual.weights and half.moments == usual.moments
    model: TwoHands = build(config(backbones, hypotheses=1), 0)
    store_frozen(model, torch.bfloat16)
    assert half.weights == tensor_bytes(model_tensors(model))
    assert plan_training(job(backbones, checkpointing=True), 8, 2).work <= usual.work
    assert plan_training(job(backbones, checkpointing=False, batch=4), 8, 2).work > 1.5 * usual.work
    assert plan_training(job(backbones, checkpointing=False, validate_every=0), 8, 2).best == 0
    assert usual.total == sum(vars(usual).values()) == usual.needed + usual.process


def test_weights_in_their_files_need_no_memory(saved: Path) -> None:
    """Weights as stored are mapped on a CPU; another type, or a GPU, takes their size."""
    config, size = read_config(saved), (saved / "model.safetensors").stat().st_size
    stored, single, card = (plan_folder(saved, config, dtype, device, 1)
                            for dtype, device in (("", "cpu"), ("float32", "cpu"), ("", "cuda")))  # fmt: skip
    assert 0.9 * size < stored.mapped <= size and stored.weights < 0.05 * size
    assert single.mapped == 0 and 1.8 * size < single.weights < 2.2 * size
    assert card.mapped == 0 and 0.9 * size < card.weights < 1.1 * size
    assert plan_folder(saved, config, "", "cuda", 8).work > 4 * card.work


def test_a_prediction_is_refused_with_what_helps(saved: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Remedies come before weights are read: the type of the files, a smaller batch, a smaller type, or how much memory to free."""
    config = read_config(saved)
    stored, single = plan_folder(saved, config, "", "cpu", 1), plan_folder(saved, config, "float32", "cpu", 1)
    monkeypatch.setattr("afford.twohands.model.large.fill_weights", lambda *_, **__: pytest.fail("weights were read"))
    free(monkeypatch, (stored.needed + single.needed) // 2)
    with pytest.raises(ValueError, match=r"it needs \d\.\d GiB on cpu \(.*\), and \d\.\d GiB are free; leave --dtype out: the wei"):
        load_model(saved, "float32")
    card = plan_folder(saved, config, "", "cuda", 1)
    free(monkeypatch, card.needed)
    with pytest.raises(ValueError, match=r"GiB are free; use --batch 1$"):
        load_model(saved, device="cuda", pictures=8)
    free(monkeypatch, 0)
    with pytest.raises(ValueError, match=r"GiB are free; free 0\.0 GiB and leave --dtype out, or use --device cpu$"):
        load_model(saved, "float32", device="cuda")


def test_a_training_is_refused_with_what_helps(backbones: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The setting that makes it fit by itself, else all of them together."""
    def planned(one: TwoHandsJob, train: int, val: int) -> MemoryPlan:
        return MemoryPlan(weights=4 if one.frozen_dtype == "float32" else 2, work=one.batch * (2 if one.checkpointing else 4))

    usual = job(backbones, batch=4, checkpointing=True)
    monkeypatch.setattr(training, "plan_training", planned)
    settings = free(monkeypatch, 12)
    check_training(usual, 8, 2)
    assert settings
    fewer = r"set model_train\.batch=1 with .*=4"
    both = rf"{fewer} and model_train\.frozen_dtype=bfloat16"
    for size, advice in ((6, f"{fewer}$"), (4, f"{both}$"), (3, rf"free 0\.0 GiB and {both}$")):
        free(monkeypatch, size)
        with pytest.raises(ValueError, match=rf"GiB are free; {advice}"):
            check_training(usual, 8, 2)


def test_the_least_memory_is_named_where_nothing_fits(monkeypatch: pytest.MonkeyPatch) -> None:
    free(monkeypatch, GIB)
    make_room(MemoryPlan(weights=GIB), "cpu", "run", [])
    with pytest.raises(ValueError, match=r"run: it needs 4\.0 GiB on cpu \(weights 4\.0\), and 1\.0 .*; free 2\.0 GiB and do this"):
        make_room(MemoryPlan(weights=4 * GIB), "cpu", "run", [("do this", lambda: MemoryPlan(weights=2 * GIB))])


def test_the_verb_plans_a_folder(saved: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Predictions in each type, and a training as it is set; another folder is a usage error."""
    assert plan(saved, "cpu", 1, ("model_train.frozen_dtype=float16", "model_train.accumulate=1"), True) == 0
    rows = json.loads(capsys.readouterr().out)["gib"]
    uses = [f"predict{dtype} --batch 1" for dtype in ("", " --dtype float32", " --dtype bfloat16")]
    assert [row["use"] for row in rows] == [*uses, "train, batch 2, frozen_dtype=float16"]
    assert all(row["total"] > row["process"] > 0 for row in rows)
    with pytest.raises(UsageError, match="expected a two-hand model of the variant vlm, or backbones"):
        plan(tmp_path, "cpu", 1, (), True)


@pytest.mark.slow
def test_the_paper_recipe_of_7b_fits_a_card_of_24_gib(tmp_path: Path) -> None:
    """The plan fits with frozen weights in bfloat16 and checkpointing; not with frozen weights in single precision."""
    params = replace(model_train.VLM, backbones=str(write_backbones(tmp_path, "7b")), device="cuda")
    both = (replace(params, frozen_dtype=dtype) for dtype in ("bfloat16", "float32"))
    half, single = (plan_training(model_train.training_job(one)) for one in both)
    assert half.total < 24 * GIB < single.total
