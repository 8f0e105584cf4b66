"""Evidence of the network of held objects in one sampled frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from schemas.video import Hand


@dataclass(frozen=True)
class HeldEvidence:
    """Evidence of the network in one sampled frame."""

    odds: np.ndarray
    """(h, w) float32, log odds of an object that any hand holds; 0 outside the crops"""
    touch: Mapping[Hand, float]
    """side -> probability that the hand touches an object"""
