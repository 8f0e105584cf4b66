"""Batch number n of a training: samples drawn, augmented, letter-boxed and stacked. A function of (seed, n), in any order."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from afford.dataset.load import Item
from afford.training.order import Order
from afford.training.views import Views, view

Box = Callable[[np.ndarray], np.ndarray]
"""(h, w, 3) image, or (n, h, w) masks, of any size -> the same at the size of the model"""


class Arrays(NamedTuple):
    """b samples at the size of the model."""

    image: np.ndarray
    """(b, H, W, 3) uint8 RGB"""
    masks: np.ndarray
    """(b, 4, H, W) bool: affordance left, right; complete object left, right"""
    task: tuple[str, ...]
    taxonomy: np.ndarray
    """(b,) int64, 0..3"""


@dataclass(frozen=True)
class Batches:
    """`batches(n)` is batch n."""

    samples: Sequence[Item]
    order: Order
    views: Views
    image_box: Box
    mask_box: Box
    size: int
    """samples per batch"""
    seed: int

    def __call__(self, number: int) -> Arrays:
        drawn = [self._sample(number * self.size + n) for n in range(self.size)]
        return stack(drawn, self.image_box, self.mask_box)

    def _sample(self, position: int) -> Item:
        _, index = self.order.sample(position)
        return view(self.samples[index], self.views, self.seed, position)


def stack(items: Sequence[Item], image_box: Box, mask_box: Box) -> Arrays:
    """Samples of any size -> arrays at the size of the model."""
    return Arrays(
        image=np.stack([image_box(item.image) for item in items]),
        masks=np.stack([mask_box(item.masks) for item in items]),
        task=tuple(item.narration for item in items),
        taxonomy=np.array([item.taxonomy for item in items], np.int64),
    )
