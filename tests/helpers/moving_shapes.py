"""A small clip of textured shapes that move over a moving textured ground, with its truth, for tests of tracking."""

from __future__ import annotations

import cv2
import numpy as np

from afford.extraction.sources.outlines import trace
from schemas.video import Annotation, Clip, Frames, KeyFrame

WIDTH_PX, HEIGHT_PX = 160, 112
HAND, CUP = 1, 2


def texture(seed: int, tint: tuple[float, float, float]) -> np.ndarray:
    """Smooth random picture (2h, 2w, 3) float32 around a colour."""
    noise = np.random.default_rng(seed).normal(0, 1, (HEIGHT_PX * 2, WIDTH_PX * 2, 3)).astype(np.float32)
    return cv2.GaussianBlur(noise, (0, 0), 2) * 180 + np.array(tint, np.float32)


def render(t: int, entering: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Frame t: rgb (h, w, 3) uint8 and labels (h, w) int16. A cup moves with the hand that covers a part of it."""
    ground = texture(0, (120, 120, 110))
    y, x = np.mgrid[:HEIGHT_PX, :WIDTH_PX].astype(np.float32)
    image = cv2.remap(ground, x + np.float32(20 + 1.5 * t), y + np.float32(20 + 0.5 * t), cv2.INTER_LINEAR)
    labels = np.zeros((HEIGHT_PX, WIDTH_PX), np.int16)
    way = 40 + 2.0 * t
    lift = max(0.0, 64.0 - 8 * t) if entering else 0.0
    for label, tint, (cx, cy), (rx, ry) in (
        (CUP, (60, 90, 190), (way, 50.0), (16, 22)),
        (HAND, (205, 150, 120), (way + 14, 62 + lift), (20, 14)),
    ):
        inside = ((x - cx) / rx) ** 2 + ((y - cy) / ry) ** 2 < 1
        own = cv2.remap(texture(label, tint), x + np.float32(100 - cx), y + np.float32(100 - cy), cv2.INTER_LINEAR)
        image[inside], labels[inside] = own[inside], label
    return np.clip(image, 0, 255).astype(np.uint8), labels


def film(frames: int, entering: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """rgb (t, h, w, 3) uint8 and labels (t, h, w) int16."""
    rgb, labels = zip(*(render(t, entering) for t in range(frames)), strict=True)
    return np.stack(rgb), np.stack(labels)


def annotate(number: int, mask: np.ndarray, name: str, side: str = "", contact: str = "") -> Annotation:
    """One annotation of frame `number`; its id is 'name@number'."""
    return Annotation(f"{name}@{number}", name, -1, side, contact, "y", trace(mask))


def key_frame(number: int, *annotations: Annotation) -> KeyFrame:
    """Key frame on the grid of the frames themselves."""
    return KeyFrame(number, WIDTH_PX, HEIGHT_PX, annotations)


def clip_of(keys: list[KeyFrame], last: int) -> Clip:
    """A clip with these key frames."""
    return Clip("T01_01", "T01_01", "T01", "", ("a.mp4",), "video", 30.0, False, 1, last, tuple(keys), (), ())


def frames_of(rgb: np.ndarray, numbers: np.ndarray | None = None) -> Frames:
    """Frames with data-set numbers 1, 2, ... by default."""
    numbers = np.arange(1, len(rgb) + 1) if numbers is None else numbers
    return Frames("T01_01", numbers.astype(np.int64), (numbers * 33_333_333).astype(np.int64), rgb)
