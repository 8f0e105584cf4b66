"""A rendered picture made to look like any other: other surroundings, skin-coloured things that are no hands, light, lens, noise.

Networks that see only clean pictures of rendered rooms take fright at a real one. What makes a hand must stay: its form, that its
colour is one of skin's, and where its arm comes from.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from afford.common.palette import TONES
from afford.render.patterns import cloud
from schemas.scene import LEFT_HAND, REST, RIGHT_HAND

Pictured = tuple[np.ndarray, np.ndarray]
"""(h, w, 3) uint8 and its labels (h, w) uint8"""
Change = Callable[[np.ndarray, np.random.Generator], np.ndarray]


@dataclass(frozen=True)
class Disguise:
    """How often, and how much."""

    turn_deg: float = 30.0
    """pictures are turned by up to so much"""
    share: tuple[float, float] = (0.45, 1.1)
    """how much of the width of a picture is shown"""
    stretch: float = 0.15
    """how much wider or higher things may become"""
    centred: float = 0.3
    """share of pictures that are cut out around some pixel of a hand, where there is one"""
    elsewhere: float = 0.4
    """share of pictures whose arms and touched things are put before other surroundings"""
    lookalikes: float = 0.35
    """share of pictures with things of the colour of skin behind the hands"""
    covered: float = 0.12
    """share of pictures with things in front of everything"""
    soft: float = 0.35
    """share of pictures that are blurred, or moved while the shutter was open"""
    packed: float = 0.5
    """share of pictures that went through JPEG"""


def framed(one: Pictured, size: tuple[int, int], rng: np.random.Generator,
           d: Disguise) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Turned, cut out and perhaps mirrored to `size` (height, width), hands changing sides in the mirror; also where the picture
    reaches (h, w) bool.
    """
    rgb, labels = one
    if rng.random() < 0.5:
        rgb, labels = rgb[:, ::-1], mirrored(labels[:, ::-1])
    matrix = _window(labels, size, rng, d)
    warp = (matrix, size[::-1])
    seen = cv2.warpAffine(np.ascontiguousarray(rgb), *warp, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    found = cv2.warpAffine(np.ascontiguousarray(labels) + np.uint8(1), *warp, flags=cv2.INTER_NEAREST, borderValue=0)
    return seen, np.where(found == 0, REST, found - 1).astype(np.uint8), found > 0


def mirrored(labels: np.ndarray) -> np.ndarray:
    """Left and right hands exchanged."""
    swap = np.arange(256, dtype=np.uint8)
    swap[[LEFT_HAND, RIGHT_HAND]] = RIGHT_HAND, LEFT_HAND
    return np.asarray(swap[labels])


def disguised(one: Pictured, behind: Pictured, size: tuple[int, int], rng: np.random.Generator, d: Disguise) -> Pictured:
    """A lesson of `size` (height, width) made from a picture, and from one without hands that is put behind it."""
    rgb, labels = placed(one, behind, size, rng, d)
    return recorded(coloured(rgb, rng), rng, d), labels


def placed(one: Pictured, behind: Pictured, size: tuple[int, int], rng: np.random.Generator, d: Disguise) -> Pictured:
    """The same before the light changes: what is shown, and before and behind what."""
    rgb, labels, inside = framed(one, size, rng, d)
    other = framed(behind, size, rng, d)[0]
    kept = (labels != REST) if rng.random() < d.elsewhere else inside
    rgb = _before(rgb, other, kept)
    if rng.random() < d.lookalikes:
        rgb = _before(rgb, _blobs(rgb, rng, _skin), labels != REST)
    if rng.random() < d.covered:
        before = _blobs(rgb, rng, _any)
        labels = np.where((before != rgb).any(2), REST, labels).astype(np.uint8)
        rgb = before
    return rgb, labels


def coloured(rgb: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """In other light, by another camera: exposure, colour of the light, contrast and saturation."""
    level = (rgb.astype(np.float32) / 255) ** np.float32(rng.uniform(0.7, 1.4))
    level *= np.float32(np.exp(rng.normal(-0.1, 0.25))) * np.exp(rng.normal(0, 0.07, 3)).astype(np.float32)
    grey = level.mean(2, keepdims=True)
    level = grey + (level - grey) * np.float32(rng.uniform(0.6, 1.4))
    middle = np.float32(level.mean())
    level = middle + (level - middle) * np.float32(rng.uniform(0.7, 1.3))
    return np.asarray(np.clip(level * 255 + 0.5, 0, 255).astype(np.uint8))


def recorded(rgb: np.ndarray, rng: np.random.Generator, d: Disguise) -> np.ndarray:
    """Soft, noisy and compressed."""
    if rng.random() < d.soft:
        rgb = _moved(rgb, rng) if rng.random() < 0.5 else cv2.GaussianBlur(rgb, (0, 0), float(rng.uniform(0.3, 1.6)))
    noise = rng.standard_normal(rgb.shape, np.float32) * np.float32(rng.uniform(0, 6))
    rgb = np.clip(rgb + noise + 0.5, 0, 255).astype(np.uint8)
    if rng.random() < d.packed:
        packed = cv2.imencode(".jpg", rgb, (cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(20, 90))))[1]
        rgb = np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR))
    return rgb


def _window(labels: np.ndarray, size: tuple[int, int], rng: np.random.Generator, d: Disguise) -> np.ndarray:
    """(2, 3) matrix from the pixels of a picture to those of the cut-out."""
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


def _before(front: np.ndarray, back: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """`front` where the mask is, with a seam one pixel soft."""
    weight = cv2.GaussianBlur(mask.astype(np.float32), (3, 3), 0)[..., None]
    return (front * weight + back * (1 - weight) + 0.5).astype(np.uint8)


def _blobs(rgb: np.ndarray, rng: np.random.Generator, colour: Callable[[np.random.Generator], np.ndarray]) -> np.ndarray:
    """The picture with one to three roundish things on it, lit from one side."""
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
        shade = 1 + 0.2 * np.tanh(slope) + 0.15 * (_spotted(height, width, rng) - 0.5)
        out[mask] = np.clip(colour(rng) * shade[mask][:, None], 0, 255).astype(np.uint8)
    return out


def _spotted(height: int, width: int, rng: np.random.Generator) -> np.ndarray:
    return cv2.resize(cloud(rng, 32, float(rng.uniform(0.5, 2.0))), (width, height))


def _skin(rng: np.random.Generator) -> np.ndarray:
    return np.array(TONES[int(rng.integers(len(TONES)))]) * rng.uniform(0.7, 1.25) * rng.uniform(0.92, 1.08, 3)


def _any(rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(0, 255, 3)


def _moved(rgb: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Blurred along a line."""
    reach, turn = float(rng.uniform(2, 8)), float(rng.uniform(0, np.pi))
    side = 2 * int(np.ceil(reach / 2)) + 1
    kernel = np.zeros((side, side), np.uint8)
    off = np.array([np.cos(turn), np.sin(turn)]) * reach / 2
    ends = [tuple(round(v) for v in side // 2 + sign * off) for sign in (-1, 1)]
    cv2.line(kernel, ends[0], ends[1], 1)
    return np.asarray(cv2.filter2D(rgb, -1, kernel / np.float32(kernel.sum())))
