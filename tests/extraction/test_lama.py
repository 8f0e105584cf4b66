"""LaMa as a backend, with the real loading code, on a tiny random generator that the test saves itself."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import save_file
from torch import Tensor, nn

from afford.extraction.inpaint.lama import fill, generator_tensors, load
from afford.extraction.inpaint.lama_network import FourierUnit, Generator, LamaConfig
from schemas.video import Inpainted, PixelSource
from stages.extraction import hand_inpaint
from stages.extraction.hand_inpaint import Params
from tests.helpers.blocks import changed
from tests.helpers.tiny_inpainters import LAMA, lama, lama_checkpoint, random_tensors, save_lama
from tests.helpers.toy_clip import Toy, toy

CPU, FLOAT = torch.device("cpu"), torch.float32
BIG_LAMA = 50_975_875
"""parameters; the paper says 51 million"""


@pytest.fixture(scope="module")
def clip() -> Toy:
    return toy(rows=slice(None, None, 5))


@pytest.fixture(scope="module")
def params(tmp_path_factory: pytest.TempPathFactory) -> Params:
    return changed(Params(backend="lama"), model=str(save_lama(tmp_path_factory.mktemp("lama") / "a.safetensors")), device="cpu")


@pytest.fixture(scope="module")
def found(clip: Toy, params: Params) -> Inpainted:
    return run(clip, params)


def run(clip: Toy, params: Params) -> Inpainted:
    return hand_inpaint.run(clip.frames, clip.tracks, params)


class Scripted(nn.Module):
    """The generator as the published TorchScript has it: inside a model, inside a wrapper that takes a picture and its mask."""

    def __init__(self, generator: Generator) -> None:
        super().__init__()
        self.model = nn.Module()
        self.model.generator = generator

    def forward(self, image: Tensor, mask: Tensor) -> Tensor:
        known = torch.cat([image * (1 - mask), mask], 1)
        return mask * self.model.generator(known) + (1 - mask) * image


def test_pixels_outside_the_mask_are_unchanged(clip: Toy, found: Inpainted) -> None:
    """Pixels inside the mask have confidence 0."""
    assert found.rgb.shape == clip.frames.rgb.shape and found.rgb.dtype == np.uint8 and found.mask.any()
    assert np.array_equal(found.rgb[~found.mask], clip.frames.rgb[~found.mask])
    assert (found.rgb[found.mask] != clip.frames.rgb[found.mask]).any(axis=1).mean() > 0.9
    assert (found.source[found.mask] == PixelSource.SPATIAL).all() and (found.confidence[found.mask] == 0).all()


def test_output_depends_on_weights_and_is_deterministic(clip: Toy, params: Params, found: Inpainted, tmp_path: Path) -> None:
    """The fill depends on the frame and on the weights only."""
    assert run(clip, params).rgb.tobytes() == found.rgb.tobytes()
    other = changed(params, model=str(save_lama(tmp_path / "b.safetensors", seed=1)))
    assert run(clip, other).rgb.tobytes() != found.rgb.tobytes()


def test_the_hand_itself_is_not_seen(clip: Toy, params: Params, found: Inpainted) -> None:
    """Other colours inside the mask change nothing."""
    rgb = np.where(found.mask[..., None], 255 - clip.frames.rgb, clip.frames.rgb)
    other = hand_inpaint.run(replace(clip.frames, rgb=rgb), clip.tracks, params)
    assert np.array_equal(other.rgb[found.mask], found.rgb[found.mask])


def test_squares_around_the_holes(clip: Toy, params: Params, found: Inpainted) -> None:
    """Less is seen, so something else is painted; outside the mask nothing is."""
    other = run(clip, changed(params, window_px=64))
    assert not np.array_equal(other.rgb, found.rgb)
    assert np.array_equal(other.rgb[~other.mask], clip.frames.rgb[~other.mask])


def test_any_size_is_filled_as_it_is() -> None:
    """Heights and widths that are no multiples of 8 come back as they went in, one by one as in a batch."""
    rng = np.random.default_rng(0)
    rgb, holes = rng.integers(0, 256, (2, 45, 67, 3), np.uint8), rng.random((2, 45, 67)) > 0.8
    both, one = fill(lama(), rgb, holes), fill(lama(), rgb[1:], holes[1:])
    assert both.shape == rgb.shape and both.dtype == np.uint8
    assert np.abs(both[1].astype(int) - one[0]).max() <= 1


@torch.no_grad()
def test_a_fourier_unit_convolves_the_spectrum() -> None:
    """One with the identity as weights keeps what has a spectrum of no negative part: a single bright corner."""
    unit, x = FourierUnit(1).eval(), torch.zeros(1, 1, 8, 8)
    unit.conv_layer.weight.copy_(torch.eye(2).view(2, 2, 1, 1))
    x[..., 0, 0] = 1
    assert torch.allclose(unit(x), x, atol=1e-4)


# -- files -------------------------------------------------------------------------------------------------------------


def test_lama_has_the_published_size_and_names() -> None:
    """Big LaMa on the meta device, against names and shapes written down by themselves."""
    with torch.device("meta"):
        model = Generator(LamaConfig())
        given = {name: torch.empty(shape) for name, shape in lama_checkpoint(LamaConfig()).items()}
    assert sum(parameter.numel() for parameter in model.parameters()) == BIG_LAMA
    own = {name: tuple(tensor.shape) for name, tensor in model.state_dict().items()}
    assert {name: tuple(tensor.shape) for name, tensor in generator_tensors(given).items()} == own


def test_torchscript_gives_the_same_model(tmp_path: Path) -> None:
    """Its tensors are read by name, without its code; a trainer's checkpoint with them as well. Sizes come from the tensors."""
    generator = lama()
    example = (torch.rand(1, 3, 32, 32), torch.ones(1, 1, 32, 32))
    torch.jit.trace(Scripted(generator).eval(), example, check_trace=False).save(str(tmp_path / "a.pt"))
    state = {f"generator.{name}": tensor for name, tensor in generator.state_dict().items()}
    torch.save({"state_dict": state, "optimizer_states": [{"lr": 1e-3}]}, tmp_path / "b.ckpt")
    for name in ("a.pt", "b.ckpt"):
        model = load(str(tmp_path / name), CPU, FLOAT)
        assert model.config == LAMA
        assert all(torch.equal(tensor, generator.state_dict()[key]) for key, tensor in model.state_dict().items())
        with torch.no_grad():
            x = torch.rand(1, 4, 16, 24)
            assert torch.equal(model(x), generator(x))


def test_invalid_weights_are_refused(clip: Toy, params: Params, tmp_path: Path) -> None:
    """A missing name, a missing file, other or missing tensors and another shape are each refused in one sentence."""
    broken = random_tensors(lama_checkpoint(LAMA))
    del broken["generator.model.5.conv1.bn_l.weight"]
    broken["generator.model.34.extra"] = torch.zeros(1)
    save_file(broken, tmp_path / "broken.safetensors")
    save_file({"other.weight": torch.zeros(2)}, tmp_path / "foreign.safetensors")
    (tmp_path / "text.pt").write_text("not a model")
    for model, message in (("", "needs a model"), (str(tmp_path), "which is not a file"),
                        (str(tmp_path / "foreign.safetensors"), r"expected the tensor model\.1\.ffc\.convl2l\.weight"),
                        (str(tmp_path / "broken.safetensors"), r"2 of \d+ tensors do not fit: extra model\.34\.extra, missing "
                         r"model\.5\.conv1\.bn_l\.weight; give LaMa's"),
                        (str(tmp_path / "text.pt"), "expected a checkpoint or TorchScript")):  # fmt: skip
        with pytest.raises(ValueError, match=message) as error:
            run(clip, changed(params, model=model))
        assert "\n" not in str(error.value)
