"""Samples made of simple shapes, for the tests and the benchmark of the data set; no extraction stage is involved."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from afford.common.image_files import encode_jpeg
from schemas.affordance import Sample, Samples
from schemas.video import Narration

TASKS = (
    ("pick up the left mug with the right hand", "pick-up", 0, "take", "mug:left", 13, "mug"),
    ("open jar", "open", 3, "open", "jar", 34, "jar"),
    ("solder the Leftover wire, left of the board", "solder", -1, "solder", "wire", -1, "wire"),
    ("cut bread", "cut", 7, "cut", "bread", 20, "bread"),
)


class Scratch:
    """A context whose scratch folder is a test's."""

    def __init__(self, scratch: Path) -> None:
        self.scratch = scratch
        self.said: list[tuple[int, int]] = []

    def progress(self, done: int, total: int) -> None:
        self.said.append((done, total))


def narration(n: int) -> Narration:
    """The n-th task, over and over."""
    text, verb, verb_class, verb_key, noun, noun_class, noun_key = TASKS[n % len(TASKS)]
    return Narration(f"N_{n}", 1, 1000, text, verb, verb_class, verb_key, noun, noun_class, noun_key, (noun,))


def image(rng: np.random.Generator, height: int, width: int) -> np.ndarray:
    """A smooth picture with some grain, (h, w, 3) uint8."""
    coarse = rng.integers(40, 220, (6, 8, 3)).astype(np.uint8)
    smooth = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    return cv2.add(smooth, rng.integers(0, 24, (height, width, 3)).astype(np.uint8))


def blob(height: int, width: int, x: float, y: float, radius: float) -> np.ndarray:
    """A wavy disc, (h, w) bool."""
    rows, columns = np.mgrid[:height, :width]
    angle = np.arctan2(rows - y, columns - x)
    return np.hypot(columns - x, rows - y) < radius * (1 + 0.15 * np.sin(5 * angle))


def masks(rng: np.random.Generator, taxonomy: int, height: int, width: int) -> np.ndarray:
    """(4, h, w) bool: affordances inside objects, empty on the side without a hand; what is of the left hand has a hole."""
    out = np.zeros((4, height, width), bool)
    for side, active in enumerate((taxonomy != 1, taxonomy != 0)):
        if active:
            x, y = rng.uniform(0.25, 0.75) * width, rng.uniform(0.3, 0.7) * height
            out[2 + side] = blob(height, width, x, y, height / 5)
            out[side] = out[2 + side] & blob(height, width, x - height / 6, y, height / 8)
    out[::2] &= ~blob(height, width, width / 2, height / 2, height / 25)
    return out


def sample(rng: np.random.Generator, video: str, n: int, taxonomy: int, height: int, width: int) -> Sample:
    """One sample with frame number n + 1."""
    motion = np.cumsum(rng.normal(0, 2, (4, 11, 2)), axis=1).astype(np.float32) + np.float32([width / 2, height / 2])
    motion[1 if taxonomy == 0 else 0, 5:] = np.nan
    return Sample(f"{video}_{n + 1:010d}", n + 1, n * 20_000_000, encode_jpeg(image(rng, height, width), 95),
                  masks(rng, taxonomy, height, width), "" if taxonomy == 1 else "mug", "" if taxonomy == 0 else "jar",
                  narration(n), taxonomy, 0.5 + 0.01 * (n % 50), 0.75, n + 1 - n % 15, n % 15, motion,
                  np.arange(11, dtype=np.int64) * 100_000_000)


def clip(video: str, count: int, seed: int = 0, split: str = "", participant: str = "", height: int = 64,
         width: int = 96) -> Samples:
    """A clip of `count` samples that runs through the taxonomy."""
    rng = np.random.default_rng([seed, *video.encode()])
    made = tuple(sample(rng, video, n, n % 4, height, width) for n in range(count))
    return Samples(video, video, participant or video[:3], split, width, height, made, (("no_contact", 3), ("too_small", 1)))
