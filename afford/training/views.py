"""How a sample is looked at in training: mirrored, cropped around its object, recoloured, each by a seeded chance.

The same shares as `afford.dataset.augment`, whose parts are used. A crop here is the box alone, not put on black at the size of
the image: so it comes to the model as a cropped picture does in prediction.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from afford.boxes import BORDER, box
from afford.dataset.augment import flip, recolour
from afford.dataset.load import Item


@dataclass(frozen=True)
class Views:
    """How often, and how much."""

    flip_share: float = 0.5
    """share of samples that are mirrored"""
    crop_share: float = 2 / 3
    """share of samples that are cropped around their objects"""
    margin: float = BORDER
    """border around the objects' box in validation, as a share of the longer image side"""
    margin_range: tuple[float, float] = (0.02, 0.2)
    """borders in training, each side drawn by itself"""
    colour_share: float = 0.5
    """share of samples whose colours are changed"""
    colour_range: tuple[float, float] = (0.6, 1.4)
    """brightness, contrast and saturation are each multiplied by a factor from this range"""


def view(item: Item, views: Views, seed: int, position: int) -> Item:
    """The sample as it is seen at this position of the training."""
    rng = np.random.default_rng((seed, position))
    chance, factors, margins = rng.random(3), rng.uniform(*views.colour_range, 3), rng.uniform(*views.margin_range, 4)
    if chance[0] < views.flip_share:
        item = flip(item)
    if chance[1] < views.crop_share:
        item = cut(item, margins)
    return replace(item, image=recolour(item.image, *factors)) if chance[2] < views.colour_share else item


def cropped(item: Item, views: Views) -> Item:
    """The sample as the benchmark crops it."""
    return cut(item, np.full(4, views.margin))


def cut(item: Item, margins: np.ndarray) -> Item:
    """The box of the objects (of the affordances, where none is known) with margins (left, top, right, bottom), shares of the
    longer side; the whole sample when there is no mask. The motion is left behind."""
    union = np.asarray(item.masks[2:].any(0))
    union = union if union.any() else np.asarray(item.masks.any(0))
    if not union.any():
        return item
    down, across = box(union, (margins * max(union.shape)).round().astype(int).tolist())
    return replace(item, image=item.image[down, across], masks=item.masks[:, down, across], motion=item.motion[:, :0])
