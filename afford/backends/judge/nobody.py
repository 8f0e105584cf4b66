"""Nobody is asked."""

from __future__ import annotations

from typing import Any

import numpy as np


def judge(name: str, frames: np.ndarray, seconds: np.ndarray, params: Any) -> float:
    """NaN."""
    return float("nan")
