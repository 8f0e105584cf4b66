"""Rendered stills: a table with objects, tasks, and every valid way to grasp for each task."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class CyclesParams:
    """Parameters of the painter `cycles`."""

    samples: int = 8
    """paths per pixel, before the denoiser"""
