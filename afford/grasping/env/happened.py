"""What a step of n worlds brought."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Happened:
    """(n,) each."""

    reward: np.ndarray
    terms: dict[str, np.ndarray]
    """that the reward is the sum of"""
    terminated: np.ndarray
    truncated: np.ndarray
    success: np.ndarray
    """so far"""
