"""The small model can learn: a few samples by heart, regions, hands and words."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from afford.dataset.load import Item
from afford.training.loop import deterministic, train
from afford.training.params import Plan
from afford.training.sampler import BalancedSampler
from afford.twohands.model.interface import ModelConfig, build
from afford.twohands.model.losses import LossParams
from afford.twohands.train.augment import Augmentation, uncropped
from afford.twohands.train.samples import NO_MOTION
from afford.twohands.train.task import Batches, InputSize, TwoHandsTask, validation_batches

SIZE = (96, 128)
TASKS = ("take red cup", "take blue cup", "lift red tray", "open the jar")
AS_IT_IS = Augmentation(flip_share=0, crop_share=0, stretch_share=0, colour_share=0)


def sample(n: int) -> Item:
    """Make one of eight samples: two pictures of four discs, with four tasks each.

    The tasks take the left hand, the right one, or both on one disc or on two.
    """
    rng = np.random.default_rng(n // 4)
    image = rng.integers(90, 110, (*SIZE, 3), np.uint8)
    discs = np.zeros((4, *SIZE), np.uint8)
    for disc, (x, y), radius, colour in zip(discs, rng.permutation([(24, 26), (64, 30), (104, 26), (60, 74)]), (20, 18, 17, 19),
                                            rng.integers(0, 255, (4, 3)).tolist(), strict=True):  # fmt: skip
        cv2.circle(disc, (int(x), int(y)), radius, 1, -1)
        image[disc > 0] = colour
    hands = ((0, None), (None, 1), (2, 2), (3, 0))[n % 4]
    masks = np.zeros((4, *SIZE), bool)
    for side, disc in enumerate(hands):
        if disc is not None:
            masks[side], masks[2 + side] = discs[disc] > 0, discs[disc] > 0
    return Item(sample_id=str(n), video="v", frame=n, narration=TASKS[n % 4], verb="take", noun="cup", verb_class=0, noun_class=0,
                object_left="", object_right="", taxonomy=n % 4, quality=1.0, image=image, masks=masks, motion=NO_MOTION,
                motion_time_ns=np.zeros(0, np.int64))  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("hypotheses", [1, 3])
def test_the_training_loop_overfits_eight_samples(hypotheses: int, tmp_path: Path) -> None:
    """IoU above 0.95 of the top-ranked regions and every taxonomy right, after 250 steps (small case: test_small_model.py)."""
    samples, boxes = [sample(n) for n in range(8)], InputSize(SIZE)
    config = ModelConfig(size_px=SIZE, widths=(16, 32, 64), text_buckets=512, hypotheses=hypotheses)
    batches = Batches(samples, BalancedSampler([0] * 8, 0, 0), AS_IT_IS, boxes, 8, 0)
    judged = validation_batches([uncropped(item) for item in samples], boxes, 8)
    loss = LossParams(mask="bce", mask_weight=1.0, dice_weight=2.0)
    hands = TwoHandsTask(build(config, 0), batches, judged, loss, "affordance", "cpu")
    plan = Plan(steps=250, lr=3e-3, warmup=20, validate_every=250)
    with deterministic(1, "cpu"):
        state = train(hands, plan, tmp_path, lambda done, total: None)
    found = {point.name: point.value for point in state.points if point.step == plan.steps}
    assert found["val.iou"] > 0.95 and found["val.taxonomy"] == 1.0
