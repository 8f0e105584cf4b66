"""How a sample is looked at in training: mirrored, cropped around its object, stretched, recoloured, its things called by words
that nobody knows, each by a seeded chance.

The same shares as `afford.dataset.augment`, whose parts are used. A crop here is the box alone, not put on black at the size of
the image: so it comes to the model as a cropped picture does in prediction.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np

from afford.common.masks import BORDER, box
from afford.dataset.augment import flip, recolour
from afford.dataset.load import Item

MIRROR = np.array([-1, 1], np.float32)


@dataclass(frozen=True)
class Augmentation:
    """How often, and how much."""

    flip_share: float = 0.5
    """share of samples that are mirrored"""
    crop_share: float = 2 / 3
    """share of samples that are cropped around their objects"""
    margin: float = BORDER
    """border around the objects' box in validation, as a share of the longer image side"""
    margin_range: tuple[float, float] = (0.02, 0.2)
    """borders in training, each side drawn by itself"""
    stretch_share: float = 0.5
    """share of samples that are made wider or narrower"""
    stretch_range: tuple[float, float] = (0.8, 1.25)
    """by a factor from this range"""
    nameless_share: float = 0.0
    """share of samples whose things are called by a word that means nothing: they are cropped, and only the picture tells"""
    colour_share: float = 0.5
    """share of samples whose colours are changed"""
    colour_range: tuple[float, float] = (0.6, 1.4)
    """brightness, contrast and saturation are each multiplied by a factor from this range"""


class View(NamedTuple):
    """A sample as it is looked at."""

    item: Item
    centre: np.ndarray
    """(2,) float32: centre of its things in the whole picture, x to the right and y down, -1..1; NaN when there are none"""


def augment(item: Item, views: Augmentation, seed: int, position: int) -> View:
    """The sample as it is seen at this position of the training."""
    rng = np.random.default_rng((seed, position))
    flipped, crop, stretch, nameless, colour = rng.random(5) < [views.flip_share, views.crop_share, views.stretch_share,
                                                                views.nameless_share, views.colour_share]  # fmt: skip
    factors, margins = rng.uniform(*views.colour_range, 3), rng.uniform(*views.margin_range, 4)
    item, at = crop_to_objects(item, margins) if crop or nameless else whole(item)
    if flipped:
        item, at = flip(item), at * MIRROR
    if stretch:
        item = change_width(item, float(np.exp(rng.uniform(*np.log(views.stretch_range)))))
    if nameless:
        item = replace_nouns(item, rng)
    return View(replace(item, image=recolour(item.image, *factors)) if colour else item, at)


def whole(item: Item) -> View:
    """The sample as it is."""
    return View(item, centre(object_mask(item)))


def cropped(item: Item, views: Augmentation) -> View:
    """The sample as the benchmark crops it."""
    return crop_to_objects(item, np.full(4, views.margin))


def crop_to_objects(item: Item, margins: np.ndarray) -> View:
    """The box of the things with margins (left, top, right, bottom), shares of the longer side; the whole sample when there are
    none. The motion is left behind.
    """
    union = object_mask(item)
    if not union.any():
        return whole(item)
    down, across = box(union, (margins * max(union.shape)).round().astype(int).tolist())
    small = replace(item, image=item.image[down, across], masks=item.masks[:, down, across], motion=item.motion[:, :0])
    return View(small, centre(union))


def change_width(item: Item, factor: float) -> Item:
    """The sample, so many times as wide. The motion is left behind."""
    height, width = item.image.shape[:2]
    size = max(1, round(width * factor)), height
    planes = [cv2.resize(plane.view(np.uint8), size, interpolation=cv2.INTER_NEAREST_EXACT).view(bool)
              for plane in np.ascontiguousarray(item.masks)]
    image = cv2.resize(np.ascontiguousarray(item.image), size, interpolation=cv2.INTER_LINEAR)
    return replace(item, image=image, masks=np.stack(planes), motion=item.motion[:, :0])


def replace_nouns(item: Item, rng: np.random.Generator) -> Item:
    """The sample with its things called by words of random letters, each its own."""
    task = item.narration
    for name in sorted({item.object_left, item.object_right, *item.noun.split(":")} - {""}):
        word = "".join(chr(ord("a") + letter) for letter in rng.integers(26, size=rng.integers(3, 9)))
        task = re.sub(rf"\b{re.escape(name)}\b", word, task)
    return replace(item, narration=task)


def object_mask(item: Item) -> np.ndarray:
    """(h, w) bool: the complete objects, or the affordances where no object is known."""
    union = np.asarray(item.masks[2:].any(0))
    return union if union.any() else np.asarray(item.masks.any(0))


def centre(mask: np.ndarray) -> np.ndarray:
    """(2,) float32: mean place of the pixels of a mask (h, w), x and y from -1 to 1 over the picture; NaN when it has none."""
    if not mask.any():
        return np.full(2, np.nan, np.float32)
    axes = (np.linspace(-1, 1, 2 * side + 1)[1::2] for side in mask.shape[::-1])
    return np.array([np.average(at, weights=mask.sum(axis)) for axis, at in enumerate(axes)], np.float32)
