"""End-point error of scene flow."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

MOVES_M = 1e-3
"""what moves by less in a frame is at rest"""


class EndPointError(NamedTuple):
    """Mean distance between motion found and true motion, in m per frame."""

    all: float
    """over every pixel whose truth is known"""
    moving: float
    """over those that truly move; NaN when none does"""
    moving_share: float
    """how many of the known pixels that are"""


def end_point_error(found_m: np.ndarray, truth_m: np.ndarray, known: np.ndarray) -> EndPointError:
    """Motion (..., 3) in m per frame, `known` (...) bool. NaN when nothing is known."""
    miss = np.linalg.norm(found_m.astype(np.float64) - truth_m, axis=-1)[known]
    moving = np.linalg.norm(truth_m[known], axis=-1) > MOVES_M
    return EndPointError(_mean(miss), _mean(miss[moving]), _mean(moving.astype(float)))


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if values.size else float("nan")
