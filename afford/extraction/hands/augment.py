"""Augmentation of rendered pictures of hands: crop, other background, skin, skin-coloured distractors, light, blur, noise, JPEG.

A network trained on clean renderings fails on real pictures. Augmentation keeps the cues of a hand: its shape, a skin colour, and
the side at which its arm enters.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from afford.extraction.hands.distractors import blobs, face, random_colour, retone, skin_colour
from schemas.scene import LEFT_HAND, REST, RIGHT_HAND

EDGE = 0.03
"""strip cut off below where a crop is larger than its picture, as a share of the crop; so arms still enter from the border"""

Labelled = tuple[np.ndarray, np.ndarray]
"""picture (h, w, 3) uint8 and its labels (h, w) uint8"""
Background = Callable[[tuple[int, int], np.random.Generator, "Augmentation"], np.ndarray]
"""draws a background without hands (h, w, 3) uint8 of a size (height, width)"""


@dataclass(frozen=True)
class Augmentation:
    """Probabilities and ranges of the augmentation."""

    turn_deg: float = 30.0
    """largest rotation"""
    share: tuple[float, float] = (0.3, 2.4)
    """range of the width of the crop, as a share of the picture, log-uniform; beyond 1 another background surrounds the picture"""
    stretch: float = 0.15
    """largest change of the aspect ratio (log)"""
    centred: float = 0.3
    """probability of a crop around a pixel of a hand"""
    elsewhere: float = 0.55
    """probability of another background behind arms and touched objects"""
    surfaces: float = 0.6
    """probability that the other background is a surface or a photograph rather than a rendered room"""
    photographed: float = 0.7
    """probability that it is a photograph, where there are any, rather than a surface"""
    lookalikes: float = 0.3
    """probability of skin-coloured distractors behind the hands"""
    faces: float = 0.1
    """probability of a face behind the hands"""
    retoned: float = 0.3
    """probability of paler, darker or flatter skin"""
    gloved: float = 0.06
    """probability of gloves: hands of any colour"""
    covered: float = 0.12
    """probability of occluders in front of everything"""
    soft: float = 0.35
    """probability of blur, by defocus or by motion"""
    packed: float = 0.5
    """probability of JPEG compression"""
    smeared: float = 0.3
    """probability of blurred colour, as in video with one colour sample for four pixels"""


def random_crop(one: Labelled, size: tuple[int, int], rng: np.random.Generator,
           d: Augmentation) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Rotate, crop and randomly mirror to `size` (height, width); mirroring swaps left and right hands.

    Returns picture, labels, and the mask (h, w) bool of pixels inside the original picture.
    """
    rgb, labels = one
    if rng.random() < 0.5:
        rgb, labels = rgb[:, ::-1], swap_sides(labels[:, ::-1])
    matrix = _crop_matrix(labels, size, rng, d)
    warp = (matrix, size[::-1])
    seen = cv2.warpAffine(np.ascontiguousarray(rgb), *warp, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    found = cv2.warpAffine(np.ascontiguousarray(labels) + np.uint8(1), *warp, flags=cv2.INTER_NEAREST, borderValue=0)
    return seen, np.where(found == 0, REST, found - 1).astype(np.uint8), found > 0


def swap_sides(labels: np.ndarray) -> np.ndarray:
    """Swap left and right hands in labels."""
    swap = np.arange(256, dtype=np.uint8)
    swap[[LEFT_HAND, RIGHT_HAND]] = RIGHT_HAND, LEFT_HAND
    return np.asarray(swap[labels])


def augment(one: Labelled, behind: Background, size: tuple[int, int], rng: np.random.Generator, d: Augmentation) -> Labelled:
    """Augment a picture to `size` (height, width); `behind` draws its background."""
    rgb, labels = composite(one, behind, size, rng, d)
    return camera_effects(colour_jitter(rgb, rng), rng, d), labels


def composite(one: Labelled, behind: Background, size: tuple[int, int], rng: np.random.Generator, d: Augmentation) -> Labelled:
    """Crop the picture and compose it with background, distractors and occluders."""
    rgb, labels, inside = random_crop(one, size, rng, d)
    kept = (labels != REST) if rng.random() < d.elsewhere else inside
    rgb = _blend(retone(rgb, labels, rng, d.retoned, d.gloved), behind(size, rng, d), kept)
    if rng.random() < d.lookalikes:
        rgb = _blend(rgb, blobs(rgb, rng, skin_colour), labels != REST)
    if rng.random() < d.faces:
        rgb = _blend(rgb, face(rgb, rng), labels != REST)
    if rng.random() < d.covered:
        before = blobs(rgb, rng, random_colour)
        labels = np.where((before != rgb).any(2), REST, labels).astype(np.uint8)
        rgb = before
    return rgb, labels


def colour_jitter(rgb: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Jitter exposure, white balance, contrast and saturation."""
    level = (rgb.astype(np.float32) / 255) ** np.float32(rng.uniform(0.6, 1.5))
    level *= np.float32(np.exp(rng.normal(-0.1, 0.3))) * np.exp(rng.normal(0, 0.1, 3)).astype(np.float32)
    grey = level.mean(2, keepdims=True)
    level = grey + (level - grey) * np.float32(rng.uniform(0.6, 1.4))
    middle = np.float32(level.mean())
    level = middle + (level - middle) * np.float32(rng.uniform(0.5, 1.3))
    return np.asarray(np.clip(level * 255 + 0.5, 0, 255).astype(np.uint8))


def camera_effects(rgb: np.ndarray, rng: np.random.Generator, d: Augmentation) -> np.ndarray:
    """Apply blur, blurred colour, noise and JPEG compression."""
    if rng.random() < d.soft:
        rgb = _motion_blur(rgb, rng) if rng.random() < 0.5 else cv2.GaussianBlur(rgb, (0, 0), float(rng.uniform(0.3, 1.6)))
    if rng.random() < d.smeared:
        rgb = _blur_colour(rgb, float(rng.uniform(0.5, 2.5)))
    noise = rng.standard_normal(rgb.shape, np.float32) * np.float32(rng.uniform(0, 6))
    rgb = np.clip(rgb + noise + 0.5, 0, 255).astype(np.uint8)
    if rng.random() < d.packed:
        packed = cv2.imencode(".jpg", rgb, (cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(10, 90))))[1]
        rgb = np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR))
    return rgb


def _crop_matrix(labels: np.ndarray, size: tuple[int, int], rng: np.random.Generator, d: Augmentation) -> np.ndarray:
    """Matrix (2, 3) from the pixels of a picture to those of its crop."""
    (height, width), (down, across) = labels.shape, size
    share = float(np.exp(rng.uniform(*np.log(d.share))))
    scale = across / (share * width) * np.exp(rng.uniform(-d.stretch, d.stretch, 2) / 2)
    turn = np.radians(rng.uniform(-d.turn_deg, d.turn_deg)) / max(share, 1.0)
    linear = scale[:, None] * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    middle = np.array([width, height]) * (0.5 + rng.uniform(-1, 1, 2) * max(1 - share, 0.0) / 2)
    there = np.flatnonzero((labels == LEFT_HAND) | (labels == RIGHT_HAND))
    if len(there) and rng.random() < d.centred:
        row, column = divmod(int(rng.choice(there)), width)
        middle = np.array([column, row]) + rng.uniform(-0.3, 0.3, 2) * min(share, 1.0) * width
    if share > 1:
        middle[1] = height - (0.5 + EDGE) * down / scale[1]
    return np.c_[linear, np.array([across, down]) / 2 - linear @ middle]


def _blend(front: np.ndarray, back: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Blend `front` inside the mask over `back`, with a seam of one pixel."""
    weight = cv2.GaussianBlur(mask.astype(np.float32), (3, 3), 0)[..., None]
    return (front * weight + back * (1 - weight) + 0.5).astype(np.uint8)


def _blur_colour(rgb: np.ndarray, reach_px: float) -> np.ndarray:
    """Blur the colour of a picture and keep its brightness."""
    split = cv2.cvtColor(rgb, cv2.COLOR_RGB2YCrCb)
    split[..., 1:] = cv2.GaussianBlur(split[..., 1:], (0, 0), reach_px)
    return np.asarray(cv2.cvtColor(split, cv2.COLOR_YCrCb2RGB))


def _motion_blur(rgb: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Blur along a line, as motion does."""
    reach, turn = float(rng.uniform(2, 8)), float(rng.uniform(0, np.pi))
    side = 2 * int(np.ceil(reach / 2)) + 1
    kernel = np.zeros((side, side), np.uint8)
    off = np.array([np.cos(turn), np.sin(turn)]) * reach / 2
    ends = [tuple(round(v) for v in side // 2 + sign * off) for sign in (-1, 1)]
    cv2.line(kernel, ends[0], ends[1], 1)
    return np.asarray(cv2.filter2D(rgb, -1, kernel / np.float32(kernel.sum())))
