"""A detector of single pictures to compare SOR3D-AFF with."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class BoxesParams:
    """Parameters of `boxes` in static evaluation."""

    true_boxes: bool = False
    """the thing's true box is given, instead of the model's own proposals"""
