"""Laws of outlines: a thing of its own colour is found whole from a part of it, nothing where it must not be."""

from __future__ import annotations

import numpy as np

from afford.common.masks import iou
from afford.extraction.hands.refine import CERTAIN, EXCLUDED, PROBABLE, segment_grabcut

HEIGHT, WIDTH = 120, 160


def scene() -> tuple[np.ndarray, np.ndarray]:
    """A red disc on a grey cloth, both with noise: picture and disc."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    disc = (y - 60) ** 2 + (x - 80) ** 2 < 30**2
    noise = np.random.default_rng(0).normal(0, 12, (HEIGHT, WIDTH, 3))
    return (np.where(disc[..., None], (190, 40, 50), (120, 125, 120)) + noise).clip(0, 255).astype(np.uint8), disc


def odds_of(inner: np.ndarray, outer: np.ndarray) -> np.ndarray:
    out = np.zeros((HEIGHT, WIDTH), np.float32)
    out[inner], out[outer] = CERTAIN + 1, EXCLUDED - 1
    return out


def test_a_part_of_a_thing_becomes_all_of_it() -> None:
    """Its middle is sure, its rim is not known, and so is some cloth around it."""
    rgb, disc = scene()
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    away = np.hypot(y - 60, x - 80)
    found = segment_grabcut(odds_of(away < 18, away > 45), rgb, np.zeros_like(disc))
    assert iou(found, disc) > 0.9


def test_grabcut_removes_the_halo() -> None:
    """Probable pixels around the object, where flow extends beyond its outline, are removed."""
    rgb, disc = scene()
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    away = np.hypot(y - 60, x - 80)
    odds = odds_of(away < 25, away > 50)
    odds[(away >= 25) & (away < 38)] = PROBABLE + 1
    assert iou(segment_grabcut(odds, rgb, np.zeros_like(disc)), disc) > 0.9 > iou(odds > PROBABLE, disc)


def test_grabcut_respects_the_excluded_mask_and_is_deterministic() -> None:
    """Pixels of `never` are never foreground, and two runs agree."""
    rgb, disc = scene()
    never = np.zeros_like(disc)
    never[:, :80] = True
    odds = odds_of(disc, ~disc)
    found = segment_grabcut(odds, rgb, never)
    assert found.any() and not (found & never).any()
    assert np.array_equal(found, segment_grabcut(odds, rgb, never))


def test_grabcut_without_certain_foreground_or_background_is_empty() -> None:
    """GrabCut needs certain pixels of both classes."""
    rgb, disc = scene()
    nothing = np.zeros((HEIGHT, WIDTH), np.float32)
    assert not segment_grabcut(nothing, rgb, np.zeros_like(disc)).any()
    assert not segment_grabcut(nothing + CERTAIN + 1, rgb, np.zeros_like(disc)).any()
