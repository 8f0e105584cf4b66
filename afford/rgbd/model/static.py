"""Pictures with affordance labels -> what a model says of each, at the size of its labels."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from afford.dataset.packed_sequences import PackedSequence
from afford.rgbd.model.inputs import Seen
from afford.rgbd.model.predictor import Predictor
from afford.rgbd.model.sequence_batches import fitted
from schemas.interaction import InteractionClip, StaticSample


class Told(NamedTuple):
    """Of the middle square of a picture, s px wide."""

    probability: np.ndarray
    """(10, s, s) float32"""
    attention: np.ndarray
    """(h', w') float32, (0, 0) for a model without"""
    box_px: np.ndarray
    """(k, 4) float32 left, top, right, bottom of the things that were found, for models that look for them"""


Teller = Callable[[StaticSample], Told]


def teller(folder: Path, device: str, params: None) -> Teller:
    """Answers of the model in `folder`, in static mode: a sequence of one frame."""
    predictor = Predictor(folder, device)

    def tell(sample: StaticSample) -> Told:
        found = predictor.predict(seen(sample, predictor.config.size_px))
        return Told(enlarged(found.probability, min(sample.label.shape)), found.attention, np.zeros((0, 4), np.float32))

    return tell


def seen(sample: StaticSample, size_px: int) -> Seen:
    """A picture as a model sees it: the middle square; depth is 0 where there is none."""
    depth_m = sample.depth_m if len(sample.depth_m) else np.zeros((1, *sample.label.shape), np.float32)
    none, still = np.zeros((0, *sample.rgb.shape), np.uint8), np.zeros(3, np.uint8)
    one = fitted(PackedSequence(sample.name, sample.object_type, "", sample.rgb[None], depth_m, none, still, sample.label), size_px)
    return Seen(one.rgb, one.depth_m, one.flow, one.still)


def square(image: np.ndarray) -> np.ndarray:
    """The middle square of (h, w, ...), as `fitted` cuts it."""
    height, width = image.shape[:2]
    side = min(height, width)
    top, left = (height - side) // 2, (width - side) // 2
    return image[top : top + side, left : left + side]


def enlarged(probability: np.ndarray, side: int) -> np.ndarray:
    """(10, h, w) at another size; sums stay 1, for it is linear."""
    return np.stack([cv2.resize(plane, (side, side), interpolation=cv2.INTER_LINEAR) for plane in probability])


def last_picture(clip: InteractionClip) -> StaticSample:
    """The last frame of a sequence, which is the one that has a label."""
    return StaticSample(clip.name, "sor3d", clip.split, clip.object_type, clip.rgb[-1], clip.depth_m[-1:], clip.label, clip.K[None])
