"""Seeded augmentation at load time: the same (seed, epoch, index) gives the same sample.

Defaults are those of 2HandedAfforder's data set (flip, crops around the object, colour jitter), which stores them unseeded. A
flip also swaps the words left and right, unlike the released code.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from afford.common.masks import BORDER, box
from afford.common.text import swap_sides
from afford.dataset.load import Item
from schemas.affordance import MIRRORED

SWAP_MASKS, SWAP_PATHS = [1, 0, 3, 2], [1, 0, 3, 2]
GREY = np.array([0.299, 0.587, 0.114], np.float32)


@dataclass(frozen=True)
class Settings:
    """Probabilities and ranges of the augmentations."""

    flip_share: float = 0.5
    """share of samples that are mirrored"""
    crop_share: float = 2 / 3
    """share of samples that are cropped around their object"""
    crop_margin: float = BORDER
    """border around the object's box, as a share of the longer image side"""
    crop_words: tuple[str, ...] = ("something", "things")
    """narrations that contain one of these words are always cropped, because only the image shows which object is meant"""
    colour_share: float = 0.25
    """share of samples whose colours are jittered"""
    colour_range: tuple[float, float] = (0.4, 1.6)
    """brightness, contrast and saturation are each multiplied by a factor from this range"""


def augment(item: Item, settings: Settings, seed: int, epoch: int, index: int) -> Item:
    """Flip, crop and recolour one sample at random."""
    rng = np.random.default_rng((seed, epoch, index))
    chance = rng.random(3)
    factors = rng.uniform(*settings.colour_range, 3)
    if chance[0] < settings.flip_share:
        item = flip(item)
    if chance[1] < settings.crop_share or any(word in item.narration.lower() for word in settings.crop_words):
        item = crop(item, settings.crop_margin)
    return replace(item, image=recolour(item.image, *factors)) if chance[2] < settings.colour_share else item


def flip(item: Item) -> Item:
    """Mirror a sample: image, masks, motion, sides of hands and objects, taxonomy and words. Two flips are the identity."""
    motion = item.motion[SWAP_PATHS].copy()
    motion[..., 0] = item.image.shape[1] - 1 - motion[..., 0]
    return replace(
        item,
        image=np.ascontiguousarray(item.image[:, ::-1]),
        masks=np.ascontiguousarray(item.masks[SWAP_MASKS, :, ::-1]),
        motion=motion,
        taxonomy=int(MIRRORED[item.taxonomy]),
        narration=swap_sides(item.narration),
        verb=swap_sides(item.verb),
        noun=swap_sides(item.noun),
        object_left=swap_sides(item.object_right),
        object_right=swap_sides(item.object_left),
    )


def crop(item: Item, margin: float) -> Item:
    """Zoom to the held objects: their box with a margin, scaled to the image size and centred on black.

    A sample without an object is unchanged.
    """
    height, width = item.image.shape[:2]
    things = item.masks[2] | item.masks[3]
    if not things.any():
        return item
    down, across = box(things, round(margin * max(height, width)))
    tall, wide = down.stop - down.start, across.stop - across.start
    scale = min(width / wide, height / tall)
    size = round(wide * scale), round(tall * scale)
    left, top = (width - size[0]) // 2, (height - size[1]) // 2
    image, planes = np.zeros_like(item.image), np.zeros_like(item.masks)
    place = slice(top, top + size[1]), slice(left, left + size[0])
    image[place] = cv2.resize(item.image[down, across], size, interpolation=cv2.INTER_LINEAR)
    for plane, source in zip(planes, item.masks, strict=True):
        plane[place] = cv2.resize(source[down, across].view(np.uint8), size, interpolation=cv2.INTER_NEAREST_EXACT).view(bool)
    stretch = np.array([size[0] / wide, size[1] / tall])
    motion = (item.motion - [across.start, down.start] + 0.5) * stretch - 0.5 + [left, top]
    return replace(item, image=image, masks=planes, motion=motion.astype(np.float32))


def recolour(image: np.ndarray, brightness: float, contrast: float, saturation: float) -> np.ndarray:
    """Scale the colours of an image (h, w, 3) uint8; factors of 1 are the identity."""
    out = np.clip(image * np.float32(brightness), 0, 255)
    mean = np.float32((out @ GREY).mean())
    out = np.clip(mean + (out - mean) * np.float32(contrast), 0, 255)
    grey = (out @ GREY)[..., None]
    return np.clip(np.rint(grey + (out - grey) * np.float32(saturation)), 0, 255).astype(np.uint8)
