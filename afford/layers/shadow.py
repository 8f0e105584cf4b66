"""Shadows that arms cast: the outline of the arm, shifted along the light by its height, found where it can be seen.

A lamp throws an arm's outline onto the table beside it. The shift grows linearly from the hand to where the arm leaves the
image, all along one direction. Two heights per frame and one direction per arm are searched for so that the shifted outline
explains the darkening of the visible background; the same outline then tells which pixels behind the arm are in shadow.
"""

from __future__ import annotations

import cv2
import numpy as np

SHRINK = 4
"""shadows are soft: everything here works on images this many times smaller"""
PAD = 40
"""arms go on outside the image, this far at least (small pixels)"""
SOFT = (1.0, 2.5)
"""blurs of the outline that are tried (sigma, small pixels)"""
ANGLES = 24
HEIGHTS = np.array([0, 2, 4, 7, 10, 14, 18, 23, 28, 34, 41, 48, 56.0])
"""shifts that are tried, small pixels"""
DARK = -0.15
"""a log ratio below this is shadow"""
MIN_ARM = 20
"""smaller arms cast no shadow, small pixels"""
MIN_DARK = 0.01
"""share of the visible background in shadow below which there is no shadow to explain"""
GAIN, USUAL, CALM = 1.1, 0.85, 20.0
"""weight of the belief that a shadow is as deep as in the rest of the clip, small pixels"""
SMOOTH = np.array([1, 2, 4, 6, 8, 6, 4, 2, 1]) / 34


def cast_shadows(log_ratio: np.ndarray, weight: np.ndarray, arms: list[np.ndarray], step: int) -> np.ndarray:
    """Log ratio (t, h, w) float32, 0 or negative, that the shadows of the arms cause, on visible and hidden pixels alike.

    log_ratio, weight: (t, h, w) float32 small images of log(image / background in light), and how far that is known.
    arms: per arm (t, h, w) float32 small coverage. step: frames between which heights are searched; others are interpolated.
    """
    shade = np.zeros_like(log_ratio)
    dark = (log_ratio < DARK) & (weight > 0.5)
    if dark.sum() < MIN_DARK * max((weight > 0.5).sum(), 1):
        return shade
    depth = float(np.quantile(log_ratio[dark], 0.35))
    arms = [arm for arm in arms if (arm.sum(axis=(1, 2)) > MIN_ARM).any()]
    soft, angle = _lamp(log_ratio / depth, weight, arms)
    shades = [shade] * len(arms)
    for _ in range(2):
        for i, arm in enumerate(arms):
            rest = np.max([shade, *(other for j, other in enumerate(shades) if j != i)], axis=0)
            shades[i] = _fit_arm(log_ratio / depth - rest, weight * (1 - rest), arm, step, soft, angle)
    return depth * np.max([shade, *shades], axis=0)


def _lamp(target: np.ndarray, weight: np.ndarray, arms: list[np.ndarray]) -> tuple[float, float]:
    """Softness and direction of the shadows, the same for all arms, from a few frames."""
    some = [(arm, t) for arm in arms for t in _spread(np.flatnonzero(arm.sum(axis=(1, 2)) > MIN_ARM), 10)]
    best = (np.inf, SOFT[0], 0.0)
    for soft in SOFT:
        outlines = [(_Arm(arm[t], soft), t) for arm, t in some]
        for angle in np.arange(ANGLES) * 2 * np.pi / ANGLES:
            costs = [_best(*_match(arm, angle, target[t], weight[t], HEIGHTS[::2]))[0].min() for arm, t in outlines]
            best = min(best, (float(sum(costs)), soft, float(angle)))
    return best[1:]


def _spread(rows: np.ndarray, count: int) -> np.ndarray:
    return rows[np.unique(np.linspace(0, len(rows) - 1, count).astype(int))] if len(rows) else rows


def _fit_arm(target: np.ndarray, weight: np.ndarray, arm: np.ndarray, step: int, soft: float, angle: float) -> np.ndarray:
    """Shade (t, h, w) of one arm; `target` is 1 in full shadow, 0 in light."""
    present = np.flatnonzero(arm.sum(axis=(1, 2)) > MIN_ARM)
    chosen = present[::step]
    found = np.stack([_match(_Arm(arm[t], soft), angle, target[t], weight[t], HEIGHTS) for t in chosen])
    found = cv2.sepFilter2D(found.reshape(len(chosen), -1), -1, np.ones(1), SMOOTH, borderType=cv2.BORDER_REPLICATE)
    cost, gain = _best(*found.reshape(len(chosen), 2, -1).transpose(1, 0, 2))
    pick, at = cost.argmin(axis=1), np.arange(len(chosen))
    tips, ends = HEIGHTS[pick // len(HEIGHTS)], HEIGHTS[pick % len(HEIGHTS)]
    shade = np.zeros_like(arm)
    for t in present:
        tip, end, strength = (np.interp(t, chosen, values) for values in (tips, ends, gain[at, pick]))
        shade[t] = strength * _Arm(arm[t], soft).shifted(angle, tip, end)
    return shade


def _match(arm: _Arm, angle: float, target: np.ndarray, weight: np.ndarray, heights: np.ndarray) -> np.ndarray:
    """Energy of the shade and its match with the target, (2, k, k) float32, for all pairs (height of the tip, of the end)."""
    power, match = out = np.zeros((2, len(heights), len(heights)), np.float32)
    for i, tip in enumerate(heights):
        for j, end in enumerate(heights):
            shade = arm.shifted(angle, tip, end)
            known = weight * shade
            power[i, j], match[i, j] = (known * shade).sum(), (known * target).sum()
    return out


def _best(power: np.ndarray, match: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cost of the best strength of a shade, and that strength."""
    gain = np.clip((match + CALM * USUAL) / (power + CALM), 0, GAIN)
    return gain**2 * power - 2 * gain * match + CALM * (gain - USUAL) ** 2, gain


class _Arm:
    """A soft outline that goes on outside the image, and its axis from where it enters to its tip."""

    def __init__(self, cover: np.ndarray, soft: float) -> None:
        self.shape = cover.shape
        padded = cv2.copyMakeBorder(cover, PAD, PAD, PAD, PAD, cv2.BORDER_REPLICATE)
        self.soft = cv2.GaussianBlur(padded, (0, 0), soft)
        y, x = np.nonzero(cover > 0.5)
        points = np.stack([x, y], axis=1) + PAD
        rim = (x == 0) | (y == 0) | (x == cover.shape[1] - 1) | (y == cover.shape[0] - 1)
        self.end = points[rim].mean(axis=0) if rim.any() else points.mean(axis=0)
        away = points - self.end
        self.tip = points[np.argmax((away**2).sum(axis=1))]

    def shifted(self, angle: float, tip: float, end: float) -> np.ndarray:
        """(h, w) float32: the outline moved along `angle` by `tip` px at its tip and `end` px where it enters."""
        axis = (self.tip - self.end) / max(((self.tip - self.end) ** 2).sum(), 1.0)
        light = np.array([np.cos(angle), np.sin(angle)])
        linear = np.eye(2) + np.outer(light, (tip - end) * axis)
        offset = light * (end - (tip - end) * (axis @ self.end))
        matrix = np.column_stack([linear, offset])
        if np.linalg.det(linear) < 0.2:
            return np.zeros(self.shape, np.float32)
        moved = cv2.warpAffine(self.soft, matrix, self.soft.shape[::-1])
        return moved[PAD:-PAD, PAD:-PAD]
