"""Promptable segmentation: outlines of whatever lies at a point of a picture."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np


class Outlines(NamedTuple):
    """Nested outlines of what lies at one point: parts, wholes and groups, in no fixed order."""

    logits: np.ndarray
    """(m, h, w) float32, above 0 inside"""
    quality: np.ndarray
    """(m,) float32, expected IoU with the outline that a person would draw"""


AtPoint = Callable[[tuple[float, float]], Outlines]
"""a picture that is segmented at a point x, y, px"""
Segmenter = Callable[[np.ndarray], AtPoint]
"""a network with its files bound: picture (h, w, 3) uint8 -> segmentation at points"""
