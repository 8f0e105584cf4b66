"""Baselines without a network and without data: oracles, and a centre prior.

Each is built from a data set (here unused) and returns a `Prediction` for a case, or None without an answer.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from afford.common.masks import box
from schemas.benchmark import Case, Prediction

SPREAD = 0.15
"""standard deviation of the centre prior, as a share of the width and height of the image"""
Baseline = Callable[[Case], Prediction | None]


def whole_object(dataset: Path | None) -> Baseline:
    """Oracle: the annotated complete object of each hand."""
    return lambda case: _regions(case, case.objects)


def object_box(dataset: Path | None) -> Baseline:
    """Oracle: the box around the complete object of each hand."""
    return lambda case: _regions(case, np.stack([_filled(mask) for mask in case.objects]))


def centre(dataset: Path | None) -> Baseline:
    """Centre prior: a Gaussian in the middle of the image for both hands, whatever the task."""
    return _centre


def one_hypothesis(task: str, planes: np.ndarray, hands: np.ndarray, taxonomy: np.ndarray | None = None) -> Prediction:
    """Prediction with one hypothesis for each hand: probabilities (2, h, w), cut at 0.5; taxonomy (4,), or NaN without one."""
    known = np.full(4, np.nan) if taxonomy is None else taxonomy
    return Prediction(task, planes[:, None].astype(np.float32), np.ones((2, 1), np.float32), known.astype(np.float32), hands, 0.5)


def _centre(case: Case) -> Prediction:
    height, width = case.modes.shape[2:]
    y, x = np.mgrid[:height, :width]
    off = ((x + 0.5) / width - 0.5) ** 2 + ((y + 0.5) / height - 0.5) ** 2
    plane = np.exp(-off / (2 * SPREAD**2))
    return one_hypothesis(case.task, np.stack([plane, plane]), np.ones(2, bool))


def _regions(case: Case, masks: np.ndarray) -> Prediction | None:
    hands = np.array([mask.any() for mask in masks])
    return one_hypothesis(case.task, masks, hands) if hands.any() else None


def _filled(mask: np.ndarray) -> np.ndarray:
    out = np.zeros_like(mask)
    out[box(mask)] = True
    return out
