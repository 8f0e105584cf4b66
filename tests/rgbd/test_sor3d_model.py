"""The model of SOR3D-AFF: its memory, its attention, its modes, its shapes, its loss, its files."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from afford.rgbd.model import checkpoint, config
from afford.rgbd.model.config import ROWS, Sor3dConfig
from afford.rgbd.model.layers import CONVOLUTIONS, Attention, ConvLSTM, Encoder
from afford.rgbd.model.losses import LossParams, explicit_cross_entropy, losses, pixel_cross_entropy
from afford.rgbd.model.model import Sor3d, Sor3dOutput, build
from afford.rgbd.model.model_inputs import InputBatch, ModelInput, to_batch
from afford.rgbd.train.actions import action_classifier
from afford.training.loop import deterministic
from schemas.interaction import BACKGROUND
from tests.helpers.made_sequences import SIZE, STILL, seen

TINY = Sor3dConfig(widths=(4, 4, 8, 8), size_px=SIZE)
PAPER_PARAMETERS = 77_167_444


@pytest.fixture(scope="module")
def model() -> Sor3d:
    return build(TINY, seed=1).eval()


def asked(*seeds: int, count: int = 4, size: int = SIZE) -> InputBatch:
    return to_batch([seen(seed, count, size) for seed in seeds], TINY)


def test_one_step_of_the_memory_is_the_cell_by_hand() -> None:
    """One position, one channel: sigmoid and tanh of the sums written out, from a state that is not 0."""
    layer = ConvLSTM(1)
    with torch.no_grad():
        layer.gates.weight.zero_()
        layer.gates.weight[:, :, 1, 1] = torch.tensor([[0.5, -1.0], [1.0, 0.3], [-0.7, 2.0], [1.5, 0.2]])
        layer.gates.bias[:] = torch.tensor([0.1, 0.2, 0.3, 0.4])
    x, hidden, cell = 0.8, -0.4, 0.9
    sigmoid = lambda v: 1 / (1 + np.exp(-v))  # noqa: E731
    enter, keep = sigmoid(0.5 * x - hidden + 0.1), sigmoid(x + 0.3 * hidden + 0.2)
    leave, new = sigmoid(-0.7 * x + 2 * hidden + 0.3), np.tanh(1.5 * x + 0.2 * hidden + 0.4)
    after = keep * cell + enter * new
    got = layer.step(*(torch.full((1, 1, 1, 1), v) for v in (x,)), tuple(torch.full((1, 1, 1, 1), v) for v in (hidden, cell)))
    assert got[1].item() == pytest.approx(after, abs=1e-6) and got[0].item() == pytest.approx(leave * np.tanh(after), abs=1e-6)


def test_state_is_carried_over_frames(model: Sor3d) -> None:
    """The first frames in another order give another answer, though the last frame, and all that is decoded, is the same."""
    asking = asked(3)
    order = [1, 0, 2, 3]
    with torch.no_grad():
        first, second = model(asking), model(InputBatch(asking.appearance[:, order], asking.motion[:, order]))
    assert not torch.allclose(first.logits, second.logits) and not torch.allclose(first.action, second.action)


def test_the_future_is_not_seen() -> None:
    """The memory after frame i depends on no later frame."""
    layer = ConvLSTM(2)
    sequence = torch.randn(1, 5, 2, 4, 4)
    other = sequence.clone()
    other[:, 3:] = 7
    assert torch.equal(layer(sequence)[:, :3], layer(other)[:, :3])


@pytest.mark.parametrize("rescale", [False, True])
def test_attention_sums_to_one(rescale: bool) -> None:
    """The sum is the number of positions when it is rescaled; values are never negative."""
    layer = Attention(3, rescale)
    found = layer(torch.randn(2, 3, 5, 7) * 4, torch.randn(2, 3, 5, 7) * 4)
    assert found.shape == (2, 1, 5, 7) and (found >= 0).all()
    assert torch.allclose(found.sum((1, 2, 3)), torch.full((2,), 35.0 if rescale else 1.0), atol=1e-4)


def test_attention_is_applied_at_every_upsampling(model: Sor3d) -> None:
    """An attention of 0 blocks the latent: two latents, one answer. Without attention they differ."""
    skips = [[torch.zeros(1, width, side, side)] * 2 for width, side in zip(TINY.widths, (32, 16, 8), strict=False)]
    first, second = torch.randn(2, 1, 8, 4, 4).unbind()
    nothing = torch.zeros(1, 1, 4, 4)
    with torch.no_grad():
        assert torch.equal(model.decoder(first, skips, nothing), model.decoder(second, skips, nothing))
        assert not torch.allclose(model.decoder(first, skips, None), model.decoder(second, skips, None))


def test_a_picture_is_a_sequence_of_one_frame(model: Sor3d) -> None:
    """Static mode: no flow given, and a flow of nothing that moves, are the same, to the bit."""
    one = seen(5, 1)
    bare = to_batch([one._replace(flow=np.zeros((0, SIZE, SIZE, 3), np.uint8))], TINY)
    still = seen(5, 2)
    moves = ModelInput(np.repeat(one.rgb, 2, 0), np.repeat(one.depth_m, 2, 0), np.full_like(still.flow, 128), STILL)
    moving = to_batch([moves], TINY)
    with torch.no_grad():
        first, second = model(bare), model(InputBatch(moving.appearance[:, 1:], moving.motion[:, 1:]))
    assert torch.equal(first.logits, second.logits) and torch.equal(first.action, second.action)


def test_a_frame_sees_the_motion_that_led_to_it() -> None:
    """Flow 0 lies at frame 1; the first frame has none; the colour of no motion is 0."""
    clip = seen(0, 3)
    clip.flow[:] = 128
    clip.flow[0] = (255, 1, 128)
    motion = to_batch([clip], TINY).motion[0]
    assert (motion[0] == 0).all() and (motion[2] == 0).all()
    assert motion[1, :, 5, 5].tolist() == [1.0, -1.0, 0.0]


def test_depth_is_relative_and_holes_are_zero() -> None:
    """Nearer and farther cameras look the same; a hole, and a clip without depth, is 0."""
    clip = seen(2)
    clip.depth_m[0, 3, 3] = 0
    first, second = (to_batch([clip._replace(depth_m=np.where(clip.depth_m > 0, clip.depth_m + more, 0))], TINY).appearance[:, :, 3]
                     for more in (0, 0.5))  # fmt: skip
    assert torch.allclose(first, second, atol=1e-5) and first[0, 0, 3, 3] == 0
    assert (to_batch([clip._replace(depth_m=np.zeros_like(clip.depth_m))], TINY).appearance[:, :, 3] == 0).all()


@pytest.mark.parametrize("size", [32, 37, 61])
def test_sizes_that_do_not_halve_come_back(model: Sor3d, size: int) -> None:
    """The answer has the size of the frame, also where poolings round down."""
    with torch.no_grad():
        said = model(asked(0, 1, count=2, size=size))
    assert said.logits.shape == (2, 10, size, size) and said.attention.shape[-1] == size // 8 and said.action.shape == (2, 9)


def test_paper_width_has_the_papers_shapes() -> None:
    """300, 150, 75, 37 with 512 channels; 11 convolutions and 3 poolings a stream; 14 convolutions in the decoder."""
    with torch.device("meta"):
        large = build(config.paper(), 0)
        levels = large.appearance(torch.zeros(1, 4, 300, 300))
        said = large(InputBatch(torch.zeros(1, 2, 4, 300, 300), torch.zeros(1, 2, 3, 300, 300)))
    assert [tuple(level.shape[1:]) for level in levels] == [(64, 300, 300), (128, 150, 150), (256, 75, 75), (512, 37, 37)]
    assert said.logits.shape == (1, 10, 300, 300) and said.attention.shape == (1, 1, 37, 37)
    assert sum(parameter.numel() for parameter in large.parameters()) == PAPER_PARAMETERS
    assert sum(CONVOLUTIONS) == count(large.appearance, 3) == count(large.motion, 3) == 11
    assert count(large.decoder, 3) == 14


def count(part: torch.nn.Module, kernel: int) -> int:
    return sum(isinstance(module, torch.nn.Conv2d) and module.kernel_size[0] == kernel for module in part.modules())


def test_explicit_cross_entropy_equals_torch() -> None:
    """Value and gradient, with weights: the one of a GPU is the one of a CPU."""
    logits, label = torch.randn(2, 10, 6, 5, generator=torch.Generator().manual_seed(3)), torch.arange(60).view(2, 6, 5) % 10
    weight = torch.linspace(0.5, 3.0, 10)
    found = []
    for way in (explicit_cross_entropy, pixel_cross_entropy):
        asked = logits.clone().requires_grad_()
        way(asked, label, weight).backward()
        found.append((way(asked, label, weight), asked.grad))
    assert all(torch.allclose(one, other, atol=1e-6) for one, other in zip(*found, strict=True))


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
def test_a_training_step_on_a_gpu_gives_the_same_bytes_twice() -> None:
    """The operations of the model and of its losses have deterministic kernels."""
    grads = []
    for _ in range(2):
        with deterministic(1, "cuda"):
            made = build(TINY, 0).cuda()
            clip, label = to_batch([seen(n, 3, SIZE) for n in range(2)], TINY).to("cuda"), torch.full((2, SIZE, SIZE), BACKGROUND)
            losses(made(clip), label.cuda(), torch.tensor([0, 1]).cuda(), LossParams(dice=1.0), 0.0)["total"].backward()
            grads.append([parameter.grad.cpu() for parameter in made.parameters() if parameter.grad is not None])
    assert all(torch.equal(one, other) for one, other in zip(*grads, strict=True))


@pytest.mark.slow
def test_paper_width_learns_on_a_cpu() -> None:
    """Forward and backward of a batch of one short sequence at 300 x 300: every weight has a finite gradient."""
    large = build(config.paper(), 0)
    batch = to_batch([seen(0, 2, 300)], large.config)
    losses(large(batch), torch.full((1, 300, 300), BACKGROUND), torch.tensor([0]), LossParams(), 0.0)["total"].backward()
    assert all(parameter.grad is not None and parameter.grad.isfinite().all() for parameter in large.parameters())


@pytest.mark.parametrize("name", ROWS)
def test_rows_of_the_ablation_train(name: str) -> None:
    """Each has the parts of its name, and all of its weights get gradients, from videos and from pictures."""
    made = build(config.row(TINY, name), 0)
    said = made(asked(0, 1, count=3), asked(2, 3, count=1))
    losses(said, torch.randint(0, 10, (4, SIZE, SIZE)), torch.tensor([1, 2, 3, 4]), LossParams(), 0.0)["total"].backward()
    assert (said.attention is not None) == ("attention" in name) and (made.motion is not None) == ("flow" in name)
    assert made.appearance.stages[0][0][0].in_channels == (4 if "rgbd" in name else 3)
    assert all(parameter.grad is not None for parameter in made.parameters())


def test_loss_uses_the_label_of_the_last_frame_only(model: Sor3d) -> None:
    """A sequence of labels is refused; the skip connections depend on the last frame only."""
    asking = asked(4)
    with torch.no_grad():
        _, skips = model._encode([asking])
        changed = asking.appearance.clone()
        changed[:, :-1] = 0
        _, others = model._encode([InputBatch(changed, asking.motion)])
    assert all(torch.equal(a, b) for one, two in zip(skips, others, strict=True) for a, b in zip(one, two, strict=True))
    with pytest.raises((RuntimeError, ValueError)):
        losses(model(asking), torch.zeros(1, 4, SIZE, SIZE, dtype=torch.int64), torch.tensor([0]), LossParams(), 0.0)


def test_groups_of_several_lengths_are_independent(model: Sor3d) -> None:
    """The output of a sequence does not depend on other groups, and keeps its place."""
    videos, pictures = asked(0, 1), asked(2, 3, 4, count=1)
    with torch.no_grad():
        both, apart = model(videos, pictures), (model(videos), model(pictures))
    for name in Sor3dOutput._fields:
        assert torch.allclose(getattr(both, name), torch.cat([getattr(one, name) for one in apart]), atol=1e-5)


def test_the_action_decides_between_affordances_of_a_pixel(model: Sor3d) -> None:
    """An affordance of a pixel is the decoder's probability times that of the action; the background is unchanged."""
    asking, alone = asked(6), build(replace(TINY, told=False), seed=1).eval()
    with torch.no_grad():
        said, decoded = model(asking), alone(asking)
    more = said.logits - decoded.logits
    assert torch.allclose(more[:, :9], said.action.log_softmax(-1)[..., None, None].expand_as(more[:, :9]), atol=1e-5)
    assert torch.equal(more[:, BACKGROUND], torch.zeros_like(more[:, BACKGROUND]))


def test_memory_begins_with_spans_of_its_frames() -> None:
    """Forget gates keep 1/2 to 10/11 of a frame, input gates let in what is not kept."""
    width = TINY.widths[-1]
    gates = build(replace(TINY, memory_frames=10), seed=0).memory[1].gates.bias
    enter, keep = gates[:width].sigmoid(), gates[width : 2 * width].sigmoid()
    assert torch.allclose(enter + keep, torch.ones(width)) and keep.min() >= 0.5 and 0.7 < keep.max() <= 10 / 11


def test_small_motion_is_raised_by_its_power() -> None:
    """The sign stays, full motion stays full, nothing stays nothing."""
    clip = seen(0, 2)
    clip.flow[:] = 128
    clip.flow[0, 0, 0] = (255, 1, 128 + 13)
    motion = to_batch([clip], TINY).motion[0, 1, :, 0, 0]
    assert motion.tolist() == pytest.approx([1.0, -1.0, (13 / 127) ** 0.5])
    assert to_batch([clip], config.paper()).motion[0, 1, 2, 0, 0].item() == pytest.approx(13 / 127)


def test_loss_by_hand() -> None:
    """Two pixels and one action, in both halves of the schedule; a weight on what is not background."""
    logits = torch.zeros(1, 10, 1, 2)
    logits[0, 0, 0, 0] = np.log(9.0)
    said = Sor3dOutput(logits, torch.zeros(1, 9), None)
    label, action = torch.tensor([[[0, BACKGROUND]]]), torch.tensor([2])
    right, wrong, told = np.log(2.0), np.log(10.0), np.log(9.0)
    for done, (first, second) in ((0.0, (0.2, 0.8)), (0.75, (0.5, 0.5))):
        found = losses(said, label, action, LossParams(), done)
        assert found["total"].item() == pytest.approx(first * (right + wrong) / 2 + second * told, abs=1e-6)
    heavy = losses(said, label, action, LossParams(foreground=3.0), 0.0)
    assert heavy["pixels"].item() == pytest.approx((3 * right + wrong) / 4, abs=1e-6)
    overlap = 1 - (2 * 0.5 + 1) / (0.5 + 8 / 18 + 0.9 + 1 + 1)
    diced = losses(said, label, action, LossParams(dice=2.0), 0.0)
    assert diced["dice"].item() == pytest.approx(overlap, abs=1e-6)
    assert diced["total"].item() == pytest.approx(0.2 * (right + wrong) / 2 + 0.8 * told + 0.2 * 2.0 * overlap, abs=1e-6)


def test_saved_model_is_loaded_unchanged(model: Sor3d, tmp_path: Path) -> None:
    """Config and weights, to the bit; another config is refused."""
    checkpoint.save_model(model, tmp_path)
    back = checkpoint.load_model(tmp_path)
    with torch.no_grad():
        assert back.config == TINY and torch.equal(back(asked(1)).logits, model(asked(1)).logits)
    checkpoint.save_model(build(replace(TINY, flow="none"), 0), tmp_path / "other")
    (tmp_path / checkpoint.WEIGHTS).write_bytes((tmp_path / "other" / checkpoint.WEIGHTS).read_bytes())
    with pytest.raises(ValueError, match=r"model.safetensors: expected the weights that config.json"):
        checkpoint.load_model(tmp_path)
    (tmp_path / checkpoint.CONFIG).write_text("{}")
    with pytest.raises(ValueError, match="expected \"format\""):
        checkpoint.load_model(tmp_path)


@pytest.mark.parametrize("kind", ["pth", "safetensors"])
def test_an_encoder_from_vgg16(kind: str, tmp_path: Path) -> None:
    """The first 11 convolutions by name; depth has the mean of the colours; a misfit is one sentence."""
    widths, channels, weights = (4, 4, 8, 8), [3, 4, 4, 4, 4, 8, 8, 8, 8, 8, 8, 8], {}
    for n, (before, after) in zip(checkpoint.LAYERS, pairwise(channels), strict=True):
        weights |= {f"features.{n}.weight": torch.randn(after, before, 3, 3), f"features.{n}.bias": torch.randn(after)}
    path = tmp_path / f"vgg16.{kind}"
    save_file(weights, path) if kind == "safetensors" else torch.save(weights, path)
    for inside in (3, 4):
        encoder = Encoder(inside, widths, "none")
        checkpoint.load_vgg16(encoder, path)
        first, last = encoder.stages[0][0][0], encoder.stages[3][3][0]
        assert torch.equal(first.weight[:, :3], weights["features.0.weight"])
        assert torch.equal(last.weight, weights["features.24.weight"])
    assert torch.allclose(first.weight[:, 3], weights["features.0.weight"].mean(1))
    with pytest.raises(ValueError, match=r"expected features.0.weight of shape \(5, 3, 3, 3\), got \(4, 3, 3, 3\)"):
        checkpoint.load_vgg16(Encoder(3, (5, 4, 8, 8), "none"), path)


def test_pre_training_trains_the_models_own_stream() -> None:
    """The head holds the encoder itself: a step of its optimiser moves the weights of the model."""
    made = build(TINY, 0)
    classifier = action_classifier(made, 5, seed=0)
    before = made.appearance.stages[0][0][0].weight.clone()
    classifier(asked(0, 1).appearance).square().sum().backward()
    torch.optim.SGD(classifier.parameters(), 0.1).step()
    assert not torch.equal(before, made.appearance.stages[0][0][0].weight)


def test_weights_come_from_the_seed() -> None:
    """Same seed, same weights; another, others; the caller's random state stays."""
    torch.manual_seed(7)
    first, second, other = (build(TINY, seed).fuse.weight for seed in (3, 3, 4))
    drawn = torch.rand(1)
    torch.manual_seed(7)
    assert torch.equal(first, second) and not torch.equal(first, other) and torch.equal(drawn, torch.rand(1))


def test_bad_configs_are_refused() -> None:
    """One sentence with the expected values."""
    with pytest.raises(ValueError, match="expected flow of none, 2d, 3d"):
        Sor3dConfig(flow="4d")
    with pytest.raises(ValueError, match="no field colour"):
        Sor3dConfig.from_dict({"colour": True})
    with pytest.raises(ValueError, match="expected a row of rgb"):
        config.row(TINY, "grey")
    with pytest.raises(ValueError, match=r"flow: expected \(3, 32, 32, 3\) for a clip of 4 frames"):
        clip = seen(0)
        to_batch([clip._replace(flow=clip.flow[:1])], TINY)
