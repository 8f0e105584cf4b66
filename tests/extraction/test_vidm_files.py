"""Published VIDM checkpoints: known names, published sizes, and errors for other tensors."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file
from torch import Tensor, nn

from afford.extraction.inpaint.vidm_model import Vidm, load, rename_tensors, save
from afford.extraction.inpaint.vidm_unet import VidmConfig
from tests.helpers.tiny_inpainters import VIDM, random_tensors, save_vidm, vidm_checkpoint

CPU, FLOAT = torch.device("cpu"), torch.float32
LDM_UNET = 387_245_827
"""parameters of the U-Net of LDM's `inpainting_big`, which logs "DiffusionWrapper has 387.25 M params" """
JOIN = 256 * 256 * 4 + 256
"""the convolution over four frames, all that VIDM has more"""
VQ_F4 = 53_219_486
"""parameters of the first stage, which has no attention here"""


@pytest.fixture(scope="module")
def published() -> dict[str, Tensor]:
    return random_tensors(vidm_checkpoint(VIDM))


def count(module: nn.Module) -> int:
    return sum(parameter.numel() for parameter in module.parameters())


def test_vidm_has_the_published_size() -> None:
    """The U-Net has 387.25 million parameters and the convolution over time, as the published shapes add up to."""
    with torch.device("meta"):
        model = Vidm(VidmConfig())
    assert count(model.unet) == LDM_UNET + JOIN
    assert count(model.first_stage) == VQ_F4 and round(LDM_UNET / 1e6, 2) == 387.25
    shapes = vidm_checkpoint(VidmConfig())
    for part, prefix in ((model.unet, "model.diffusion_model."), (model.first_stage, "first_stage_model.")):
        assert count(part) == sum(math.prod(shape) for name, shape in shapes.items() if name.startswith(prefix))


def test_published_names_and_shapes() -> None:
    """Names and shapes of the published size equal an independent list."""
    with torch.device("meta"):
        model = Vidm(VidmConfig())
        given = {name: torch.empty(shape) for name, shape in vidm_checkpoint(VidmConfig()).items()}
    own = {name: tuple(tensor.shape) for name, tensor in model.state_dict().items()}
    renamed = rename_tensors(given, model.unet.state_dict(), VidmConfig())
    assert {name: tuple(tensor.shape) for name, tensor in renamed.items()} == own


def test_the_moving_average_is_preferred(published: dict[str, Tensor], tmp_path: Path) -> None:
    """A file without moving average uses the plain weights; a trainer's file and safetensors give the same model."""
    torch.save({"state_dict": published, "epoch": 3}, tmp_path / "a.ckpt")
    save_file(published, tmp_path / "b.safetensors")
    plain = {name: tensor for name, tensor in published.items() if not name.startswith("model_ema.")}
    save_file(plain, tmp_path / "c.safetensors")
    a, b, c = (load(str(tmp_path / name), CPU, FLOAT, VIDM).unet.out[4].bias
               for name in ("a.ckpt", "b.safetensors", "c.safetensors"))  # fmt: skip
    assert torch.equal(a, published["model_ema.diffusion_modelout4bias"]) and torch.equal(a, b)
    assert torch.equal(c, published["model.diffusion_model.out.4.bias"]) and not torch.equal(b, c)


def test_a_saved_model_is_the_same_model(tmp_path: Path) -> None:
    """Tensor by tensor, and saved again byte by byte."""
    first = save_vidm(tmp_path / "a")
    save(load(str(first), CPU, FLOAT), tmp_path / "b")
    for name in ("config.json", "model.safetensors"):
        assert (first / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_wrong_tensors_are_counted_and_named(published: dict[str, Tensor], tmp_path: Path) -> None:
    """Missing, extra and misshaped tensors are reported in one sentence, some by name, the rest by number."""
    broken = dict(published)
    del broken["first_stage_model.quantize.embedding.weight"]
    broken["first_stage_model.encoder.conv_in.bias"] = torch.zeros(7)
    broken["model.control.weight"] = torch.zeros(2)
    path = tmp_path / "broken.safetensors"
    save_file(broken, path)
    with pytest.raises(ValueError) as error:
        load(str(path), CPU, FLOAT, VIDM)
    message = str(error.value)
    assert message.startswith(f"{path}: 3 of ") and "\n" not in message
    assert "missing first_stage.quantize.embedding.weight" in message and "extra model.control.weight" in message
    assert "misshaped first_stage.encoder.conv_in.bias: expected (32,), got (7,)" in message and "published checkpoint" in message


def test_a_checkpoint_of_a_picture_model_is_refused(tmp_path: Path) -> None:
    """LDM's own inpainting model has the same names, but convolutions of one picture: its shapes do not fit, and it has no join."""
    shapes = vidm_checkpoint(VIDM)
    flat = {name: (*shape[:2], *shape[3:]) if len(shape) == 5 else shape for name, shape in shapes.items() if "out.2" not in name}
    save_file(random_tensors(flat), tmp_path / "ldm.safetensors")
    with pytest.raises(ValueError, match=r"tensors do not fit: .*, and \d+ more; give the published"):
        load(str(tmp_path / "ldm.safetensors"), CPU, FLOAT, VIDM)


def test_a_partial_vidm_folder_is_refused(tmp_path: Path) -> None:
    """A missing config, another format, an unknown field and missing weights are refused."""
    for text, message in (("", "expected the config"), ('{"format": "x"}', 'expected "format": "afford-vidm-1"'),
                       ('{"format": "afford-vidm-1", "depth": 3}', "unknown fields depth"),
                       ('{"format": "afford-vidm-1"}', r"model\.safetensors: expected a checkpoint")):  # fmt: skip
        (tmp_path / "config.json").write_text(text)
        with pytest.raises(ValueError, match=message):
            load(str(tmp_path), CPU, FLOAT)
