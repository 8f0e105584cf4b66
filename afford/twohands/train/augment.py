"""Augmentation of training samples: mirror, crop to the objects, change the width, the colours, what is behind them, and the nouns.

Each has a seeded chance. `afford.dataset.augment` uses the same shares. A crop is the box alone, not placed on a black image of the
original size, so that the model gets the same input as for a cropped picture at inference.
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
from afford.twohands.model.class_words import named_classes

MIRROR = np.array([-1, 1], np.float32)


@dataclass(frozen=True)
class Augmentation:
    """Shares and ranges of the augmentation."""

    flip_share: float = 0.5
    """share of samples that are mirrored"""
    crop_share: float = 2 / 3
    """share of samples that are cropped around their objects"""
    margin: float = BORDER
    """border around the objects' box in validation, as a share of the longer image side"""
    margin_range: tuple[float, float] = (0.02, 0.2)
    """range of the border in training, drawn for each side"""
    wide_share: float = 0.0
    """share of crops that show more around the objects"""
    wide_range: tuple[float, float] = (0.05, 0.6)
    """range of their border, drawn for each side"""
    stretch_share: float = 0.5
    """share of samples that are made wider or narrower"""
    stretch_range: tuple[float, float] = (0.8, 1.25)
    """range of the factor of their width"""
    colour_share: float = 0.5
    """share of samples whose colours are changed"""
    colour_range: tuple[float, float] = (0.6, 1.4)
    """range of the factors of brightness, contrast and saturation"""
    residue_share: float = 0.0
    """share of samples with one or two arm-shaped places as inpainting leaves them, anywhere in the picture"""
    pasted_share: float = 0.0
    """share of samples whose objects are shown before the picture of another sample"""
    unnamed_share: float = 0.0
    """share of samples whose things, where they have classes, are asked for by their classes alone: the nouns of the task become
    random words (`AugmentedSample.asked`). Not for a whole picture: its classifier hardly sees small things, so that nothing would
    show which one is meant"""
    unseen_share: float = 0.0
    """share of samples without the classes of their things, so that a model can do without"""


class AugmentedSample(NamedTuple):
    """A sample after augmentation."""

    item: Item
    centre: np.ndarray
    """(2,) float32: centre of its objects in the whole picture, x to the right and y down, -1..1; NaN without objects"""
    asked: str = ""
    """the task whose things are looked for by their classes (`Batch.asked`); '' for none"""


def augment(item: Item, views: Augmentation, seed: int, position: int, behind: np.ndarray | None = None) -> AugmentedSample:
    """Augment a sample as a function of the seed and its position in the training.

    behind: picture (h, w, 3) uint8 of any size, before which its objects are shown; None for its own.
    """
    rng = np.random.default_rng((seed, position))
    shares = views.flip_share, views.crop_share, views.wide_share, views.stretch_share, views.colour_share
    flipped, crop, wide, stretch, colour = rng.random(len(shares)) < shares
    factors, margins = rng.uniform(*views.colour_range, 3), rng.uniform(*(views.wide_range if wide else views.margin_range), 4)
    if behind is not None:
        item = replace(item, image=before(item, behind, rng))
    shown = crop_to_objects(item, margins) if crop else uncropped(item)
    item, at = shown.item, shown.centre
    if flipped:
        item, at = flip(item), at * MIRROR
    if stretch:
        item = change_width(item, float(np.exp(rng.uniform(*np.log(views.stretch_range)))))
    if colour:
        item = replace(item, image=recolour(item.image, *factors))
    if views.residue_share and rng.random() < views.residue_share:
        item = replace(item, image=leave_residue(item.image, rng))
    asked = item.narration
    if views.unnamed_share or views.unseen_share:
        drawn = rng.random()
        if drawn < views.unseen_share:
            asked = ""
        elif drawn < views.unseen_share + views.unnamed_share and named_classes(asked) and crop:
            item = replace_nouns(item, rng)
    return AugmentedSample(item, at, asked)


def before(item: Item, behind: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Objects of a sample, at their places, before a part of another picture: (h, w, 3) uint8 with soft edges.

    A sample without objects keeps its picture. Copy-paste (Ghiasi et al. 2021), with one picture.
    """
    mask = object_mask(item)
    if not mask.any():
        return item.image
    height, width = mask.shape
    scale = max(height / behind.shape[0], width / behind.shape[1]) * rng.uniform(1, 1.5)
    size = max(width, round(scale * behind.shape[1])), max(height, round(scale * behind.shape[0]))
    large = cv2.resize(np.ascontiguousarray(behind), size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
    top, left = (int(rng.integers(have - want + 1)) for have, want in zip(large.shape, mask.shape, strict=False))
    part = large[top : top + height, left : left + width]
    share = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), rng.uniform(0.5, 1.5))[..., None]
    return np.rint(item.image * share + part * (1 - share)).astype(np.uint8)


def uncropped(item: Item) -> AugmentedSample:
    """The sample without augmentation."""
    return AugmentedSample(item, mask_centre(object_mask(item)), item.narration)


def benchmark_crop(item: Item, views: Augmentation) -> AugmentedSample:
    """Crop a sample as the benchmark does."""
    return crop_to_objects(item, np.full(4, views.margin))


def crop_to_objects(item: Item, margins: np.ndarray) -> AugmentedSample:
    """Crop a sample to the box of its objects with margins (left, top, right, bottom), as shares of the longer side.

    A sample without objects is kept whole. The motion is dropped.
    """
    union = object_mask(item)
    if not union.any():
        return uncropped(item)
    down, across = box(union, (margins * max(union.shape)).round().astype(int).tolist())
    small = replace(item, image=item.image[down, across], masks=item.masks[:, down, across], motion=item.motion[:, :0])
    return AugmentedSample(small, mask_centre(union), item.narration)


def change_width(item: Item, factor: float) -> Item:
    """Multiply the width of a sample by a factor. The motion is dropped."""
    height, width = item.image.shape[:2]
    size = max(1, round(width * factor)), height
    planes = [cv2.resize(plane.view(np.uint8), size, interpolation=cv2.INTER_NEAREST_EXACT).view(bool)
              for plane in np.ascontiguousarray(item.masks)]
    image = cv2.resize(np.ascontiguousarray(item.image), size, interpolation=cv2.INTER_LINEAR)
    return replace(item, image=image, masks=np.stack(planes), motion=item.motion[:, :0])


def replace_nouns(item: Item, rng: np.random.Generator) -> Item:
    """Replace each noun in the task of a sample by its own random word."""
    task = item.narration
    for name in sorted({item.object_left, item.object_right, *item.noun.split(":")} - {""}):
        word = "".join(chr(ord("a") + letter) for letter in rng.integers(26, size=rng.integers(3, 9)))
        task = re.sub(rf"\b{re.escape(name)}\b", word, task)
    return replace(item, narration=task)


def leave_residue(image: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Repaint one or two arm-shaped places of an image (h, w, 3) uint8 as inpainting does: smooth, or with displaced texture.

    Places do not depend on the masks of the sample, so that they are no hint of where a hand was.
    """
    height, width = image.shape[:2]
    out = np.ascontiguousarray(image)
    for _ in range(int(rng.integers(1, 3))):
        reach = rng.uniform((0.1, 0.15), (0.9, 0.9)) * (width, height)
        elbow = rng.uniform((-0.2, 1.0), (1.2, 1.3)) * (width, height)
        place = np.zeros((height, width), np.uint8)
        thick = max(2, round(rng.uniform(0.06, 0.16) * width))
        ends = [tuple(int(value) for value in point.round()) for point in (reach, elbow)]
        cv2.line(place, *ends, 255, thick)
        cv2.circle(place, ends[0], max(2, round(0.7 * thick)), 255, -1)
        soft = cv2.GaussianBlur(place, (0, 0), max(0.8, 0.08 * thick))[..., None].astype(np.float32) / 255
        out = np.rint(soft * _filled(out, place, thick, rng) + (1 - soft) * out).astype(np.uint8)
    return out


def _filled(image: np.ndarray, place: np.ndarray, thick: int, rng: np.random.Generator) -> np.ndarray:
    """Fill a place (h, w) from its surroundings at a coarse scale, or from the picture beside it."""
    if rng.random() < 0.4:
        x, y = rng.uniform(-1.5, 1.5, 2) * thick
        return cv2.warpAffine(image, np.array([[1, 0, x], [0, 1, y]]), image.shape[1::-1], borderMode=cv2.BORDER_REFLECT)
    coarse = max(1, thick // 6)
    small = max(2, image.shape[1] // coarse), max(2, image.shape[0] // coarse)
    grown = cv2.dilate(cv2.resize(place, small, interpolation=cv2.INTER_AREA), np.ones((3, 3), np.uint8))
    filled = cv2.inpaint(cv2.resize(image, small, interpolation=cv2.INTER_AREA), (grown > 0).astype(np.uint8), 3, cv2.INPAINT_TELEA)
    return cv2.resize(filled, image.shape[1::-1], interpolation=cv2.INTER_LINEAR)


def object_mask(item: Item) -> np.ndarray:
    """Mask (h, w) bool of the complete objects, or of the affordances where no object is known."""
    union = np.asarray(item.masks[2:].any(0))
    return union if union.any() else np.asarray(item.masks.any(0))


def mask_centre(mask: np.ndarray) -> np.ndarray:
    """Mean position (2,) float32 of the pixels of a mask (h, w), x and y from -1 to 1 over the picture; NaN for an empty mask."""
    if not mask.any():
        return np.full(2, np.nan, np.float32)
    axes = (np.linspace(-1, 1, 2 * side + 1)[1::2] for side in mask.shape[::-1])
    return np.array([np.average(at, weights=mask.sum(axis)) for axis, at in enumerate(axes)], np.float32)
