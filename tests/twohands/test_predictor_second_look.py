"""Second look of the predictor at the crop of a small object."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch.nn.functional import avg_pool2d

from afford.common.masks import BORDER
from afford.twohands.model.interface import Batch, ModelConfig, Output, TwoHands
from afford.twohands.model.predictor import Predictor, RawPrediction, crop_window, paste_crop

SIZE = (64, 96)


class Bright(TwoHands):
    """Model whose object and right-hand region are the bright pixels; the left hand is idle. It counts its forward passes."""

    def __init__(self, with_objects: bool = True) -> None:
        super().__init__()
        self.config, self.with_objects, self.passes = ModelConfig(size_px=SIZE), with_objects, 0

    def forward(self, batch: Batch) -> Output:
        self.passes += 1
        bright = 40 * (avg_pool2d(batch.image.mean(1), 4) - 0.75)
        both = bright[:, None].expand(-1, 2, -1, -1)
        raw = torch.tensor([[0.0, 3.0, -9.0, -9.0]]).expand(len(bright), -1)
        return Output(both[:, :, None], bright.new_zeros(len(bright), 2, 1), raw, None, both if self.with_objects else None)


def picture(top: int, left: int, side: int) -> np.ndarray:
    """128 x 192 with a bright square."""
    image = np.full((128, 192, 3), 60, np.uint8)
    image[top : top + side, left : left + side] = 255
    return image


def inside(image: np.ndarray) -> np.ndarray:
    return image[..., 0] == 255


def overlap(a: np.ndarray, b: np.ndarray) -> float:
    return float((a & b).sum() / (a | b).sum())


@pytest.mark.parametrize("at", [(50, 90), (0, 0), (101, 165)])
def test_a_small_thing_is_seen_more_exactly(at: tuple[int, int]) -> None:
    """Two passes; the region is nearer to the truth than after one, in the place of the whole picture, and nowhere else."""
    model, image = Bright(), picture(*at, 27)
    once, twice = (Predictor(model, mirror=False).predict(image, "take it", looks=looks) for looks in (1, 2))
    assert model.passes == 3 and twice.probability.shape == once.probability.shape == (2, 1, 128, 192)
    found = [overlap(prediction.mask("right"), inside(image)) for prediction in (once, twice)]
    assert found[1] > 0.9 and found[1] > found[0] + 0.02
    border = round(BORDER * 192) + 4
    far = np.ones((128, 192), bool)
    far[max(at[0] - border, 0) : at[0] + 27 + border, max(at[1] - border, 0) : at[1] + 27 + border] = False
    assert not twice.probability[:, :, far].any() and not twice.mask("left").any()


@pytest.mark.parametrize(("image", "with_objects"), [
    (picture(0, 0, 128), True), (picture(0, 0, 0), True), (picture(50, 90, 27), False)])
def test_one_look_is_enough(image: np.ndarray, with_objects: bool) -> None:
    """One pass and an equal prediction for a large object, for no object, and for a model without complete objects."""
    model = Bright(with_objects)
    once, twice = (Predictor(model, mirror=False).predict(image, "take it", looks=looks) for looks in (1, 2))
    assert model.passes == 2 and np.array_equal(once.probability, twice.probability)


def test_a_batch_looks_twice_only_at_what_is_small() -> None:
    """Answers come in the order of the questions, each as if passes alone."""
    model, images = Bright(), [picture(0, 0, 128), picture(50, 90, 27), picture(0, 0, 0), picture(10, 20, 30)]
    together = Predictor(model, mirror=False).predict_batch(images, ["take it"] * 4)
    assert model.passes == 2
    for image, prediction in zip(images, together, strict=True):
        assert np.allclose(prediction.probability, Predictor(model, mirror=False).predict(image, "take it").probability, atol=1e-6)


def test_taxonomies_of_both_looks_are_averaged() -> None:
    """The geometric mean of the taxonomies, which sums to 1; scores and regions of the second look."""
    objects = torch.full((2, 16, 24), -9.0)
    objects[1, 4:8, 4:8] = 9.0
    objects[1, 12, 20] = 9.0  # a speck, far away
    objects[0, :, 12:] = 9.0  # of the hand that is idle
    first = RawPrediction(np.zeros((2, 1, 64, 96), np.float32), torch.zeros(2, 1), np.float32([0.2, 0.8, 0, 0]), objects)
    at = crop_window(first, SIZE)
    assert at is not None and at[0].stop <= 32 + 8 and at[1].stop <= 32 + 8 and at[0].start < 16 and at[1].start < 16
    closer = first._replace(probability=np.ones((2, 1, 9, 9), np.float32), taxonomy=np.float32([0.5, 0.5, 0, 0]))
    found = paste_crop(first, closer, (slice(5, 14), slice(2, 11)))
    assert found.taxonomy.sum() == pytest.approx(1) and found.taxonomy[1] / found.taxonomy[0] == pytest.approx(2)
    assert found.probability.sum() == 2 * 81 and found.probability[:, :, 5:14, 2:11].all()


@pytest.mark.parametrize("size", [(1, 1), (1, 2), (2, 1), (3, 2)])
def test_objects_between_the_pixels_of_a_tiny_picture_are_not_cropped(size: tuple[int, int]) -> None:
    """A picture of a few pixels: the object lies between the points that are kept, and no empty crop is made of it."""
    objects = torch.full((2, 16, 24), -9.0)
    objects[1, 6, 7] = 9.0
    raw = RawPrediction(np.zeros((2, 1, *size), np.float32), torch.zeros(2, 1), np.float32([0.2, 0.8, 0, 0]), objects)
    assert crop_window(raw, SIZE) is None
