"""Training of a vision-language model whose frozen weights are kept in half precision, on tiny random backbones."""

from __future__ import annotations

import copy
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file
from torch import Tensor, nn

from afford.training.train import train_job
from afford.twohands.model.frozen_weights import FrozenLinear, store_frozen
from afford.twohands.model.interface import Batch, TwoHands, build
from afford.twohands.model.losses import LossParams, losses
from afford.twohands.model.model_folder import load_model
from schemas.files import FileTree
from stages.extraction import dataset_pack
from stages.twohands import model_train
from tests.helpers.made_samples import Scratch, clip
from tests.helpers.tiny_models import save_backbones
from tests.twohands.test_model_train import Killed, refs
from tests.twohands.test_vlm_model import batch, config, step, target

LOW = (torch.bfloat16, torch.float16)


@pytest.fixture(scope="module")
def backbones(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_backbones(tmp_path_factory.mktemp("backbones"))


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> FileTree:
    clips = (clip("P01_01", 8, split="train"), clip("P01_02", 4, split="val"))
    return dataset_pack.run(clips, dataset_pack.Params(sheet_samples=1), Scratch(tmp_path_factory.mktemp("packed")))


def params(folder: Path, **change: object) -> model_train.Params:
    few = replace(model_train.VLM, backbones=str(folder), height_px=64, width_px=64, steps=5, batch=1, accumulate=1,
                  warmup=2, validate_every=3, val_samples=1, frozen_dtype="bfloat16")  # fmt: skip
    return replace(few, **change)  # type: ignore[arg-type]


def half(folder: Path, dtype: torch.dtype, **change: object) -> TwoHands:
    model = build(config(folder, **change), 0, as_stored=True)
    store_frozen(model, dtype)
    return model


def frozen(model: nn.Module) -> dict[str, Tensor]:
    return {name: one for name, one in model.named_parameters() if not one.requires_grad}


@pytest.mark.parametrize("dtype", LOW)
def test_a_frozen_layer_is_the_layer_of_its_rounded_weights(dtype: torch.dtype) -> None:
    """Output and gradient, to the bit; the graph keeps the stored weights and no cast copy."""
    layer = nn.Linear(6, 4).requires_grad_(False)
    layer.weight.data, layer.bias.data = layer.weight.data.to(dtype), layer.bias.data.to(dtype)
    x = torch.randn(3, 6, requires_grad=True)
    kept: list[Tensor] = []
    with torch.autograd.graph.saved_tensors_hooks(lambda one: kept.append(one) or one, lambda one: one):
        found = FrozenLinear(layer)(x)
    wanted = copy.deepcopy(layer).float()(x)
    assert torch.equal(found, wanted) and [one.dtype for one in kept] == [dtype]
    assert torch.equal(*(torch.autograd.grad(one.sum(), x)[0] for one in (found, wanted)))


@pytest.mark.parametrize("dtype", LOW)
def test_training_changes_trained_weights_only(backbones: Path, dtype: torch.dtype) -> None:
    """Frozen ones keep bytes and type, also while the loss falls; what is trained is in single precision."""
    model = half(backbones, dtype)
    before = {name: tensor.clone() for name, tensor in model.state_dict().items()}
    kept = {one.dtype for name, one in frozen(model).items() if "prompt_encoder" not in name}
    assert kept == {dtype} and {one.dtype for one in model.parameters() if one.requires_grad} == {torch.float32}
    torch.manual_seed(0)
    first = losses(model.train()(batch()), target(), LossParams())["total"]
    assert losses(step(model, 8), target(), LossParams())["total"] < first
    moved = {name for name, tensor in model.state_dict().items() if not torch.equal(tensor, before[name])}
    assert moved and not moved & frozen(model).keys()
    assert all(one.grad is None for one in frozen(model).values())
    assert [tensor.dtype for tensor in model.state_dict().values()] == [tensor.dtype for tensor in before.values()]


def test_trained_weights_start_as_in_single_precision(backbones: Path) -> None:
    """Backbones in float32: what is trained starts with equal bytes, what is frozen is rounded once."""
    usual, low = build(config(backbones), 0).state_dict(), half(backbones, torch.bfloat16).state_dict()
    assert usual.keys() == low.keys()
    assert all(torch.equal(usual[name].to(tensor.dtype), tensor) for name, tensor in low.items())


def test_a_training_resumes_and_predicts(dataset: FileTree, backbones: Path, tmp_path: Path) -> None:
    """A killed training ends with equal files; the saved model has both types and answers."""
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    job = model_train.training_job(params(backbones))
    whole = train_job(job, dataset, "vlm", Scratch(tmp_path / "a"), 1)
    with pytest.raises(KeyboardInterrupt):
        train_job(job, dataset, "vlm", Killed(tmp_path / "b"), 1)
    assert refs(train_job(job, dataset, "vlm", Scratch(tmp_path / "b"), 1).files) == refs(whole.files)
    folder = tmp_path / "a" / "out" / "model"
    stored = load_file(folder / "model.safetensors")
    assert {tensor.dtype for tensor in stored.values()} == {torch.float32, torch.bfloat16}
    loaded, asked = load_model(folder), Batch(torch.rand(1, 3, 64, 64), ("open the jar",))
    same = half(backbones, torch.bfloat16, hypotheses=1).eval()
    same.load_state_dict(stored)
    with torch.inference_mode():
        assert torch.equal(loaded(asked).logits, same(asked).logits)
        assert loaded.answer(asked).answer is not None


def test_other_variants_have_no_frozen_type() -> None:
    """Refused in one sentence, as is an unknown type."""
    with pytest.raises(ValueError, match=r"frozen_dtype: expected float32 for variant small, got 'bfloat16'"):
        model_train.training_job(model_train.Params(frozen_dtype="bfloat16"))
    with pytest.raises(ValueError, match="expected float32, bfloat16, float16 for variant vlm, got 'int8'"):
        model_train.training_job(model_train.Params(variant="vlm", frozen_dtype="int8"))
