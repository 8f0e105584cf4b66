"""Batch number n of a training: samples drawn, augmented, letter-boxed and stacked. A function of (seed, n), in any order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from afford.dataset.load import Item
from afford.training.sampler import BalancedSampler
from afford.twohands.model.letterbox import letterbox, letterbox_masks
from afford.twohands.train.views import Seen, Views, view


class Boxes(NamedTuple):
    """How samples come to the size of the model."""

    size_px: tuple[int, int]

    def image(self, image: np.ndarray) -> np.ndarray:
        """(h, w, 3) uint8 -> (H, W, 3) uint8."""
        return letterbox(image, self.size_px)

    def masks(self, masks: np.ndarray) -> np.ndarray:
        """(n, h, w) bool -> (n, H, W) bool."""
        return letterbox_masks(masks, self.size_px)

    def half(self) -> Boxes:
        """The same at half the size. ValueError where that is no multiple of 16 px."""
        if any(side % 32 for side in self.size_px):
            raise ValueError(f"model_train.height_px, width_px: expected multiples of 32 when some steps come at half the size "
                             f"(coarse_share is not 0), got {self.size_px}")  # fmt: skip
        return Boxes((self.size_px[0] // 2, self.size_px[1] // 2))


class Arrays(NamedTuple):
    """b samples at the size of the model."""

    image: np.ndarray
    """(b, H, W, 3) uint8 RGB"""
    masks: np.ndarray
    """(b, 4, H, W) bool: affordance left, right; complete object left, right"""
    task: tuple[str, ...]
    taxonomy: np.ndarray
    """(b,) int64, 0..3"""
    centre: np.ndarray
    """(b, 2) float32: centre of the things in the whole picture (`Seen.centre`)"""


@dataclass(frozen=True)
class Batches:
    """`batches(n)` is batch n."""

    samples: Sequence[Item]
    order: BalancedSampler
    views: Views
    boxes: Boxes
    size: int
    """samples per batch"""
    seed: int
    coarse: int = 0
    """so many batches come first, of twice as many samples at half the size: of small pictures a few are hardly dearer than one"""

    def __call__(self, number: int) -> Arrays:
        first = self.size * (number + min(number, self.coarse))
        if number < self.coarse:
            return stack([self._sample(first + n) for n in range(2 * self.size)], self.boxes.half())
        return stack([self._sample(first + n) for n in range(self.size)], self.boxes)

    def _sample(self, position: int) -> Seen:
        _, index = self.order.sample(position)
        return view(self.samples[index], self.views, self.seed, position)


def stack(seen: Sequence[Seen], boxes: Boxes) -> Arrays:
    """Samples of any size -> arrays at the size of the model."""
    items = [one.item for one in seen]
    return Arrays(
        image=np.stack([boxes.image(item.image) for item in items]),
        masks=np.stack([boxes.masks(item.masks) for item in items]),
        task=tuple(item.narration for item in items),
        taxonomy=np.array([item.taxonomy for item in items], np.int64),
        centre=np.stack([one.centre for one in seen]),
    )
