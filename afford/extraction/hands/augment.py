"""Augmentation of rendered pictures of hands: crop, other background, skin-coloured distractors, light, blur, noise, JPEG.

A network trained on clean renderings fails on real pictures. Augmentation keeps the cues of a hand: its shape, a skin colour, and
the side at which its arm enters.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from afford.common.palette import TONES
from afford.render.patterns import cloud
from schemas.scene import LEFT_HAND, REST, RIGHT_HAND

Labelled = tuple[np.ndarray, np.ndarray]
"""picture (h, w, 3) uint8 and its labels (h, w) uint8"""


@dataclass(frozen=True)
class Augmentation:
    """Probabilities and ranges of the augmentation."""

    turn_deg: float = 30.0
    """largest rotation"""
    share: tuple[float, float] = (0.45, 1.1)
    """range of the width of the crop, as a share of the picture"""
    stretch: float = 0.15
    """largest change of the aspect ratio (log)"""
    centred: float = 0.3
    """probability of a crop around a pixel of a hand"""
    elsewhere: float = 0.4
    """probability of another background behind arms and touched objects"""
    lookalikes: float = 0.35
    """probability of skin-coloured distractors behind the hands"""
    covered: float = 0.12
    """probability of occluders in front of everything"""
    soft: float = 0.35
    """probability of blur, by defocus or by motion"""
    packed: float = 0.5
    """probability of JPEG compression"""


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


def augment(one: Labelled, behind: Labelled, size: tuple[int, int], rng: np.random.Generator, d: Augmentation) -> Labelled:
    """Augment a picture to `size` (height, width); `behind` is a picture without hands for its background."""
    rgb, labels = composite(one, behind, size, rng, d)
    return camera_effects(colour_jitter(rgb, rng), rng, d), labels


def composite(one: Labelled, behind: Labelled, size: tuple[int, int], rng: np.random.Generator, d: Augmentation) -> Labelled:
    """Crop the picture and compose it with background, distractors and occluders."""
    rgb, labels, inside = random_crop(one, size, rng, d)
    other = random_crop(behind, size, rng, d)[0]
    kept = (labels != REST) if rng.random() < d.elsewhere else inside
    rgb = _blend(rgb, other, kept)
    if rng.random() < d.lookalikes:
        rgb = _blend(rgb, _blobs(rgb, rng, _skin_colour), labels != REST)
    if rng.random() < d.covered:
        before = _blobs(rgb, rng, _random_colour)
        labels = np.where((before != rgb).any(2), REST, labels).astype(np.uint8)
        rgb = before
    return rgb, labels


def colour_jitter(rgb: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Jitter exposure, white balance, contrast and saturation."""
    level = (rgb.astype(np.float32) / 255) ** np.float32(rng.uniform(0.7, 1.4))
    level *= np.float32(np.exp(rng.normal(-0.1, 0.25))) * np.exp(rng.normal(0, 0.07, 3)).astype(np.float32)
    grey = level.mean(2, keepdims=True)
    level = grey + (level - grey) * np.float32(rng.uniform(0.6, 1.4))
    middle = np.float32(level.mean())
    level = middle + (level - middle) * np.float32(rng.uniform(0.7, 1.3))
    return np.asarray(np.clip(level * 255 + 0.5, 0, 255).astype(np.uint8))


def camera_effects(rgb: np.ndarray, rng: np.random.Generator, d: Augmentation) -> np.ndarray:
    """Apply blur, noise and JPEG compression."""
    if rng.random() < d.soft:
        rgb = _motion_blur(rgb, rng) if rng.random() < 0.5 else cv2.GaussianBlur(rgb, (0, 0), float(rng.uniform(0.3, 1.6)))
    noise = rng.standard_normal(rgb.shape, np.float32) * np.float32(rng.uniform(0, 6))
    rgb = np.clip(rgb + noise + 0.5, 0, 255).astype(np.uint8)
    if rng.random() < d.packed:
        packed = cv2.imencode(".jpg", rgb, (cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(20, 90))))[1]
        rgb = np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR))
    return rgb


def _crop_matrix(labels: np.ndarray, size: tuple[int, int], rng: np.random.Generator, d: Augmentation) -> np.ndarray:
    """Matrix (2, 3) from the pixels of a picture to those of its crop."""
    (height, width), (down, across) = labels.shape, size
    share = rng.uniform(*d.share)
    scale = across / (share * width) * np.exp(rng.uniform(-d.stretch, d.stretch, 2) / 2)
    turn = np.radians(rng.uniform(-d.turn_deg, d.turn_deg))
    linear = scale[:, None] * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    middle = np.array([width, height]) * (0.5 + rng.uniform(-1, 1, 2) * max(1 - share, 0.0) / 2)
    there = np.flatnonzero((labels == LEFT_HAND) | (labels == RIGHT_HAND))
    if len(there) and rng.random() < d.centred:
        row, column = divmod(int(rng.choice(there)), width)
        middle = np.array([column, row]) + rng.uniform(-0.3, 0.3, 2) * share * width
    return np.c_[linear, np.array([across, down]) / 2 - linear @ middle]


def _blend(front: np.ndarray, back: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Blend `front` inside the mask over `back`, with a seam of one pixel."""
    weight = cv2.GaussianBlur(mask.astype(np.float32), (3, 3), 0)[..., None]
    return (front * weight + back * (1 - weight) + 0.5).astype(np.uint8)


def _blobs(rgb: np.ndarray, rng: np.random.Generator, colour: Callable[[np.random.Generator], np.ndarray]) -> np.ndarray:
    """Paint one to three roundish shaded blobs on the picture."""
    out = rgb.copy()
    height, width = rgb.shape[:2]
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    for _ in range(int(rng.integers(1, 4))):
        turn = np.sort(rng.uniform(0, 2 * np.pi, int(rng.integers(3, 12))))
        radius = rng.uniform(0.03, 0.3) * width * rng.uniform(0.4, 1.0, len(turn))
        centre = rng.uniform(0, 1, 2) * (width, height)
        outline = centre + np.stack([np.cos(turn) * rng.uniform(0.3, 1.0), np.sin(turn)], 1) * radius[:, None]
        mask = np.zeros((height, width), np.uint8)
        cv2.fillPoly(mask, [np.round(outline).astype(np.int32)], 1)
        mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5))) > 0
        slope = ((x - centre[0]) * rng.normal() + (y - centre[1]) * rng.normal()) / max(float(radius.max()), 1.0)
        shade = 1 + 0.2 * np.tanh(slope) + 0.15 * (_texture(height, width, rng) - 0.5)
        out[mask] = np.clip(colour(rng) * shade[mask][:, None], 0, 255).astype(np.uint8)
    return out


def _texture(height: int, width: int, rng: np.random.Generator) -> np.ndarray:
    return cv2.resize(cloud(rng, 32, float(rng.uniform(0.5, 2.0))), (width, height))


def _skin_colour(rng: np.random.Generator) -> np.ndarray:
    return np.array(TONES[int(rng.integers(len(TONES)))]) * rng.uniform(0.7, 1.25) * rng.uniform(0.92, 1.08, 3)


def _random_colour(rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(0, 255, 3)


def _motion_blur(rgb: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Blur along a line, as motion does."""
    reach, turn = float(rng.uniform(2, 8)), float(rng.uniform(0, np.pi))
    side = 2 * int(np.ceil(reach / 2)) + 1
    kernel = np.zeros((side, side), np.uint8)
    off = np.array([np.cos(turn), np.sin(turn)]) * reach / 2
    ends = [tuple(round(v) for v in side // 2 + sign * off) for sign in (-1, 1)]
    cv2.line(kernel, ends[0], ends[1], 1)
    return np.asarray(cv2.filter2D(rgb, -1, kernel / np.float32(kernel.sum())))
