"""The small model on a pretrained image encoder: what is trained, saved and refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from afford.models import encoder_place
from afford.models.efficientnet_lite import EfficientNetLite0
from afford.models.encoder_place import FILE
from afford.models.weights import weight_files
from afford.twohands.model.interface import Batch, ModelConfig, build
from afford.twohands.model.model_folder import load_model, save_model
from afford.twohands.model.predictor import Predictor
from commands.weights import resolve_weights
from maps.settings import Settings
from schemas.files import FileTree
from stages.extraction import dataset_pack
from stages.twohands import model_train
from tests.helpers.made_samples import Scratch, clip
from tests.helpers.tiny_root import digest

TINY = ModelConfig(variant="lite", size_px=(64, 96), widths=(16, 24, 32), depth=1, decoder_depth=1, text_buckets=512)
PARAMS = model_train.Params(variant="lite", steps=2, batch=2, warmup=1, validate_every=1, val_samples=2, height_px=64, width_px=96,
                            zoom=1.0)  # fmt: skip


@pytest.fixture(scope="module")
def encoder(tmp_path_factory: pytest.TempPathFactory) -> FileTree:
    """A random encoder, saved as the published one is."""
    folder = tmp_path_factory.mktemp("encoder")
    torch.manual_seed(1)
    model = EfficientNetLite0(10)
    for name, buffer in model.named_buffers():
        if name.endswith("running_mean"):
            buffer.normal_(std=0.1)
    torch.save(model.state_dict(), folder / FILE)
    return weight_files(str(folder / FILE), digest)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> FileTree:
    clips = (clip("P01_01", 8, split="train"), clip("P01_02", 4, split="val"))
    return dataset_pack.run(clips, dataset_pack.Params(sheet_samples=1), Scratch(tmp_path_factory.mktemp("packed")))


def batch(*tasks: str) -> Batch:
    return Batch(torch.rand(len(tasks), 3, *TINY.size_px, generator=torch.Generator().manual_seed(3)), tasks)


@pytest.mark.parametrize("change", [{}, {"hypotheses": 1}, {"text": False}, {"decoders": 1}])
def test_shapes_of_every_ablation(change: dict[str, object]) -> None:
    """Two hands, k hypotheses, stride 4, four classes."""
    config = replace(TINY, **change)
    found = build(config, 0)(batch("open jar", "put the big blue bowl on the shelf"))
    k = config.hypotheses
    assert (found.logits.shape, found.score.shape, found.taxonomy.shape) == ((2, 2, k, 16, 24), (2, 2, k), (2, 4))


def test_the_encoder_is_not_trained() -> None:
    """A step of training changes neither its weights nor its statistics, and every other parameter has a gradient."""
    model = build(TINY, 0).train()
    before = {name: tensor.clone() for name, tensor in model.state_dict().items()}
    found = model(batch("open jar", "lift bowl"))
    assert found.objects is not None and found.centre is not None
    parts = (found.logits, found.score, found.taxonomy, found.objects, found.centre)
    sum((part.float() ** 2).sum() for part in parts).backward()  # type: ignore[union-attr]  # a tensor
    for name, parameter in model.named_parameters():
        assert (parameter.grad is None) is name.startswith("encoder.backbone."), name
    after = model.state_dict()
    assert all(torch.equal(before[name], after[name]) for name in before)


def test_a_saved_model_needs_no_encoder_file(dataset: FileTree, encoder: FileTree, tmp_path: Path) -> None:
    """The stage trains on the given encoder; its folder holds all weights, and predicts."""
    trained = model_train.run(dataset, PARAMS, Scratch(tmp_path / "scratch"), weights=encoder)
    folder = trained.files.find("model/config.json").path.parent
    config = json.loads((folder / "config.json").read_text())
    assert config["variant"] == "lite" and config["backbones"] == ""
    model = load_model(folder)
    kept, published = model.state_dict(), torch.load(encoder.files[0].path, weights_only=True)
    mine = {name.removeprefix("encoder.backbone."): tensor for name, tensor in kept.items() if name.startswith("encoder.backbone.")}
    assert mine and all(torch.equal(published[name], tensor) for name, tensor in mine.items())
    found = Predictor(model).predict((255 * batch("x").image[0].permute(1, 2, 0)).byte().numpy(), "open jar")
    assert found.mask("left") is not None or found.mask("right") is not None
    save_model(model, tmp_path / "again")
    assert (tmp_path / "again" / "model.safetensors").read_bytes() == (folder / "model.safetensors").read_bytes()
    assert "EfficientNet-Lite0" in trained.files.find("card.md").path.read_text()


def test_a_training_without_encoder_is_refused() -> None:
    """The sentence names the script that fetches it, and the variant that needs none."""
    with pytest.raises(ValueError, match=r"install/image_encoder\.py`, or set model_train\.variant=small"):
        model_train.training_job(PARAMS)


def test_the_encoder_of_set_up_is_an_input(encoder: FileTree, monkeypatch: pytest.MonkeyPatch) -> None:
    """The file becomes weights of the training where `lite` is chosen, and only there."""
    monkeypatch.setattr(encoder_place, "encoder_files", lambda digest: encoder)
    for variant, wanted in (("lite", encoder), ("small", None)):
        chosen = Settings.of(model_train=replace(Settings.twohands.model_train, variant=variant))
        assert dict(resolve_weights(chosen, digest).weights).get("model_train") == wanted
