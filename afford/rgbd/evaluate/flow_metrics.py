"""End-point error of motion, in space or on the image."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

MOVES_M = 1e-3
"""what moves by less in a frame is at rest"""


class EndPointError(NamedTuple):
    """Mean distance between motion found and true motion, in the unit of the motion."""

    all: float
    """over every pixel whose truth is known"""
    moving: float
    """over those that truly move; NaN when none does"""
    moving_share: float
    """how many of the known pixels that are"""


def moves(truth_m: np.ndarray) -> np.ndarray:
    """(...) bool of true motion (..., 3) in m per frame: what is not at rest."""
    found: np.ndarray = np.linalg.norm(truth_m, axis=-1) > MOVES_M
    return found


def end_point_error(found: np.ndarray, truth: np.ndarray, known: np.ndarray, moving: np.ndarray) -> EndPointError:
    """Motion (..., k) per frame; `known` and `moving` (what `moves` says) (...) bool. NaN when nothing is known."""
    miss = np.linalg.norm(found.astype(np.float64) - truth, axis=-1)
    return EndPointError(_mean(miss[known]), _mean(miss[known & moving]), _mean(moving[known].astype(float)))


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if values.size else float("nan")
