"""Forearms and sleeves behind hands: the direction in which an arm leaves the picture, from foreground, palm and viewpoint."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import gaussian_filter1d

from afford.extraction.hands.grip import MIDDLE, WRIST, palm_size_px

ANGLES = 72
STEPS = 48
"""points of a ray from the wrist to the border of the picture"""
PALM_WEIGHT, ENTRY_WEIGHT, OUTWARD_WEIGHT, OTHER_HAND = 0.4, 0.5, 0.3, -3.0
"""weights of the axis of the palm, of the side on which the person is, of the person's left or right, and of a ray inside the
other hand, against 1 for a ray of foreground"""
MEMORY_FRAMES = 3.0
"""the direction is chosen over about so many sampled frames before and after"""
CORE, CORE_FLARE, WIDE, WIDE_FLARE = 0.5, 0.15, 0.9, 0.4
"""half width of the arm at the wrist as a share of the palm, and its growth with distance: always, and where there is foreground"""
BEHIND, CUFF = -0.1, 0.3
"""the forearm begins this share of the palm behind the wrist, or where the bare skin ends, less the second value for the cuff"""
FOREGROUND = 0.25
"""least unexplained share of foreground"""


def forearms(
    hands: Sequence[np.ndarray | None], points: Sequence[np.ndarray | None], others: Sequence[np.ndarray | None],
    foreground: Sequence[np.ndarray], towards: tuple[int, int],
) -> list[np.ndarray]:
    """Mark the forearm (h, w) bool of one side in consecutive sampled frames; none where the hand's mask contains the bare arm.

    hands: masks (h, w) bool, None where the hand is not visible; points: keypoints (21, 2) x, y, None where unknown;
    others: masks of the other hand; foreground: (h, w) float32, unexplained share of each pixel, 0..1;
    towards: signs of x and y from the hand to the shoulder of its side.
    """
    scores = np.stack([_direction_scores(*at, towards) for at in zip(hands, points, others, foreground, strict=True)])
    smooth = gaussian_filter1d(scores, MEMORY_FRAMES, axis=0, mode="constant")
    return [np.zeros(fore.shape, bool) if hand is None else _strip(hand, at, fore, _direction(int(score.argmax())))
            for hand, at, fore, score in zip(hands, points, foreground, smooth, strict=True)]  # fmt: skip


def _direction(i: int) -> np.ndarray:
    angle = 2 * np.pi * i / ANGLES
    return np.array([np.cos(angle), np.sin(angle)])


def _wrist(hand: np.ndarray, points: np.ndarray | None) -> np.ndarray:
    if points is not None:
        return points[WRIST]
    rows, columns = np.nonzero(hand)
    return np.array([columns.mean(), rows.mean()])


def _direction_scores(
    hand: np.ndarray | None, points: np.ndarray | None, other: np.ndarray | None, foreground: np.ndarray, towards: tuple[int, int]
) -> np.ndarray:
    """Score (ANGLES,) the directions in which the arm may leave the picture; zeros without a hand."""
    if hand is None or not hand.any():
        return np.zeros(ANGLES)
    height, width = hand.shape
    start, limit = _wrist(hand, points), np.array([width - 1.0, height - 1.0])
    directions = np.stack([_direction(i) for i in range(ANGLES)])
    with np.errstate(divide="ignore"):
        reach = np.where(directions > 0, (limit - start) / directions, np.where(directions < 0, -start / directions, np.inf))
    length = np.maximum(reach.min(1), 1.0)
    along = start + directions[:, None] * (length[:, None] * np.linspace(0, 1, STEPS))[..., None]
    x, y = (np.clip(np.rint(along[..., i]).astype(int), 0, limit[i].astype(int)) for i in (0, 1))
    inside = np.where(hand[y, x], 1.0, np.minimum(foreground[y, x] / (2 * FOREGROUND), 1))
    if other is not None:
        inside = np.where(other[y, x], OTHER_HAND, inside)
    score = inside.mean(1) + directions @ (np.array([OUTWARD_WEIGHT, ENTRY_WEIGHT]) * towards)
    if points is not None:
        axis = points[WRIST] - points[MIDDLE]
        score = score + PALM_WEIGHT * directions @ axis / palm_size_px(points)
    out: np.ndarray = score
    return out


def _strip(hand: np.ndarray, points: np.ndarray | None, foreground: np.ndarray, along: np.ndarray) -> np.ndarray:
    y, x = np.mgrid[: hand.shape[0], : hand.shape[1]].astype(np.float32)
    wrist = _wrist(hand, points)
    size = palm_size_px(points) if points is not None else float(np.sqrt(hand.sum()) / 1.5)
    behind = (x - wrist[0]) * along[0] + (y - wrist[1]) * along[1] - (0 if points is not None else size)
    aside = np.abs((y - wrist[1]) * along[0] - (x - wrist[0]) * along[1])
    border = np.zeros(hand.shape, bool)
    border[[0, -1]], border[:, [0, -1]] = True, True
    if (hand & border & (behind > BEHIND * size)).any():
        return border & False
    bare = behind[hand & (aside < WIDE * size)]
    start = max(BEHIND * size, float(np.quantile(bare, 0.97)) - CUFF * size if len(bare) else 0.0)
    core, wide = (aside < share * size + flare * behind for share, flare in ((CORE, CORE_FLARE), (WIDE, WIDE_FLARE)))
    out: np.ndarray = (behind > start) & (core | (wide & (foreground > FOREGROUND)))
    return out
