"""The small two-hand model: shapes, sameness, what it reads and does not read, and that it can learn."""

from __future__ import annotations

import dataclasses

import pytest
import torch
from torch import Tensor
from torch.nn.functional import interpolate

from afford.models.word_vectors import subwords
from afford.twohands.model.interface import Batch, ModelConfig, Output, Target, TwoHands, build
from afford.twohands.model.losses import LossParams, losses

TINY = ModelConfig(size_px=(64, 96), widths=(16, 24, 32), depth=1, decoder_depth=1, text_buckets=512)


def batch(*tasks: str) -> Batch:
    g = torch.Generator().manual_seed(3)
    return Batch(torch.rand(len(tasks), 3, *TINY.size_px, generator=g), tasks)


@pytest.mark.parametrize("change", [{}, {"hypotheses": 1}, {"text": False}, {"decoders": 1}])
def test_shapes_of_every_ablation(change: dict[str, object]) -> None:
    """Two hands, k hypotheses, stride 4, four classes."""
    config = dataclasses.replace(TINY, **change)
    o = build(config, 0)(batch("open jar", "put the big blue bowl on the shelf"))
    k = config.hypotheses
    assert (o.logits.shape, o.score.shape, o.taxonomy.shape) == ((2, 2, k, 16, 24), (2, 2, k), (2, 4))
    assert o.text_loss is None and o.objects is not None and o.objects.shape == (2, 2, 16, 24)


def test_half_the_size_is_the_same_place() -> None:
    """The same picture at half the size: positions lie on those of the whole one, and an answer has half the size."""
    model, b = build(TINY, 0).eval(), batch("open jar")
    half = Batch(torch.nn.functional.avg_pool2d(b.image, 2), b.task)
    assert model(half).logits.shape[-2:] == (8, 12)
    whole, coarse = (model.get_submodule("encoder").place(image).unflatten(0, (-1, columns))
                     for image, columns in ((b.image, 6), (half.image, 3)))  # fmt: skip
    middle = whole.unflatten(0, (-1, 2)).unflatten(2, (-1, 2)).mean((1, 3))
    assert torch.allclose(coarse[..., -4:], middle[..., -4:], atol=0.01)  # long waves of x, which are straight over two tokens


def test_the_centre_loss_has_no_gradient_to_object_masks() -> None:
    """The centre is predicted from the features of the objects, without a gradient to their masks."""
    model = build(TINY, 0)
    o = model(batch("open jar", "lift bowl"))
    assert o.centre is not None and o.centre.shape == (2, 2)
    o.centre.sum().backward()
    decoder = model.get_submodule("decoder")
    assert all(p.grad is None for p in decoder.get_submodule("thing").parameters())
    assert all(p.grad is not None and p.grad.any() for p in decoder.get_submodule("seen").parameters())


def test_the_default_is_small() -> None:
    """One to four million parameters."""
    assert 1e6 < sum(p.numel() for p in build(ModelConfig(), 0).parameters()) < 4e6


def test_same_seed_same_weights_and_the_caller_keeps_its_random_state() -> None:
    """Weights depend on the seed alone, and building draws nothing from the caller."""
    torch.manual_seed(5)
    expected = torch.rand(1)
    torch.manual_seed(5)
    one, two, other = (build(TINY, seed).state_dict() for seed in (7, 7, 8))
    assert torch.equal(torch.rand(1), expected)
    assert all(torch.equal(one[name], two[name]) for name in one)
    assert not torch.equal(one["decoder.queries"], other["decoder.queries"])


def test_an_answer_does_not_depend_on_its_neighbours_in_the_batch() -> None:
    """Longer tasks in a batch only add padding, which is masked."""
    model, b = build(TINY, 0).eval(), batch("cut bread", "put the big blue bowl on the upper shelf", "")
    together, alone = model(b), model(Batch(b.image[:1], b.task[:1]))
    assert torch.allclose(together.logits[:1], alone.logits, atol=1e-4)
    assert torch.allclose(together.taxonomy[:1], alone.taxonomy, atol=1e-5)


def test_the_task_matters_unless_the_model_does_not_read() -> None:
    """Another task, another answer; without text the same one."""
    image = batch("x").image
    for text in (True, False):
        model = build(dataclasses.replace(TINY, text=text), 0).eval()
        one, two = (model(Batch(image, (task,))).logits for task in ("lift bowl", "open drawer"))
        assert torch.equal(one, two) is not text


def test_one_decoder_says_the_same_for_both_hands() -> None:
    """LISA's single mask, on both sides."""
    o = build(dataclasses.replace(TINY, decoders=1), 0)(batch("lift bowl"))
    assert torch.equal(o.logits[:, 0], o.logits[:, 1]) and torch.equal(o.score[:, 0], o.score[:, 1])


def test_unseen_words_share_pieces_with_seen_ones() -> None:
    """'kettles' is nearer to 'kettle' than 'drawer' is, also from random vectors; the hash does not change between runs."""
    assert subwords("pan", 1 << 30)[0] == 986118291
    words = build(TINY, 0).get_submodule("words")
    (kettle, kettles, drawer), _ = words(("kettle", "kettles", "drawer"))
    assert (kettle - kettles).norm() < 0.7 * (kettle - drawer).norm()


def shapes() -> tuple[Batch, Target]:
    """8 pictures of a red and a blue box; the words say which one, and its side which hand."""
    g = torch.Generator().manual_seed(0)
    images, masks, tasks, labels = 0.1 * torch.rand(8, 3, *TINY.size_px, generator=g), torch.zeros(8, 2, *TINY.size_px), [], []
    for i in range(8):
        y, x = torch.randint(4, 28, (2,), generator=g).tolist()
        boxes = {"red": (slice(y, y + 28), slice(x // 4, x // 4 + 32)), "blue": (slice(40 - y, 60 - y + 4), slice(58, 84))}
        for channel, name in ((0, "red"), (2, "blue")):
            images[i, channel][boxes[name]] = 0.9
        colour = "red" if i % 2 else "blue"
        hand = int(colour == "blue")
        masks[i, hand][boxes[colour]] = 1
        tasks.append(f"take the {colour} box")
        labels.append(hand)
    label = torch.tensor(labels)
    return Batch(images, tuple(tasks)), Target(masks, torch.stack([label == 0, label == 1], dim=1), label)


def train(model: TwoHands, b: Batch, t: Target, steps: int, params: LossParams, last: float = 1.0) -> Output:
    """Train on one batch, and return the output for it.

    The learning rate decays to `last` of its first value: with a constant rate the result depends on the kind of CPU.
    """
    optimiser = torch.optim.AdamW(model.train().parameters(), lr=3e-3)
    slower = torch.optim.lr_scheduler.LinearLR(optimiser, 1.0, last, steps)
    for _ in range(steps):
        losses(model(b), t, params)["total"].backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
        optimiser.step()
        slower.step()
        optimiser.zero_grad()
    with torch.inference_mode():
        return model.eval()(b)


def iou(logits: Tensor, truth: Tensor) -> Tensor:
    """(n, h, w) logits and (n, H, W) masks -> (n,)."""
    found, inside = interpolate(logits[:, None], truth.shape[1:], mode="bilinear")[:, 0] > 0, truth.bool()
    return (found & inside).sum((1, 2)) / (found | inside).sum((1, 2))


def test_the_model_overfits_eight_samples() -> None:
    """Top-ranked regions with IoU above 0.95 and every taxonomy right; the same picture needs the words."""
    b, t = shapes()
    o = train(build(TINY, 0), b, t, 120, LossParams(grid="input", mask_weight=10), last=0.02)
    each, hand = torch.arange(8), t.taxonomy
    assert torch.equal(o.taxonomy.argmax(-1), hand)
    found = iou(o.logits[each, hand, o.score[each, hand].argmax(-1)], t.masks[each, hand])
    assert found.min() > 0.95, found


def test_hypotheses_keep_two_grips_of_one_task_apart() -> None:
    """One picture and task, two right answers for the pair of hands: k = 2 learns both pairs, k = 1 cannot."""
    image, masks = batch("x").image.expand(2, -1, -1, -1), torch.zeros(2, 2, *TINY.size_px)
    masks[0, 0, :32, :32], masks[0, 1, :32, 64:], masks[1, 0, 32:, :32], masks[1, 1, 32:, 64:] = 1, 1, 1, 1
    b, t = Batch(image, ("lift box",) * 2), Target(masks, torch.ones(2, 2, dtype=torch.bool), torch.tensor([2, 2]))
    found = []
    for k in (1, 2):
        o = train(build(dataclasses.replace(TINY, hypotheses=k), 0), b, t, 80, LossParams(epsilon=0.15))
        pairs = torch.stack([iou(o.logits[:, :, j].flatten(0, 1), masks.flatten(0, 1)).view(2, 2).mean(1) for j in range(k)])
        found.append(pairs.amax(0).min().item())  # the worse of the two modes, by its best hypothesis
    assert found[0] < 0.6 and found[1] > 0.9, found
    assert o.score.softmax(-1).amax() < 0.7  # and neither is called certain


def test_impossible_configs_are_refused() -> None:
    """The sentence names the field."""
    with pytest.raises(ValueError, match="variant"):
        ModelConfig(variant="huge")
    with pytest.raises(ValueError, match="size_px"):
        ModelConfig(size_px=(100, 100))
    with pytest.raises(ValueError, match="no field k"):
        ModelConfig.from_dict({"k": 3})
