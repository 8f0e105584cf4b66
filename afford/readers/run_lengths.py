"""COCO run lengths, plain or compressed -> masks. Checked here, because the usual C decoder crashes on malformed ones."""

from __future__ import annotations

from typing import Any

import numpy as np

FIRST = 48
"""character that stands for 0"""
MOST_BITS = 60
"""of one number; an image has fewer pixels by far"""


def decode(counts: Any, height_px: int, width_px: int) -> np.ndarray:
    """(height_px, width_px) bool: runs of 0 and 1 in turn, down the columns. ValueError when they do not fill the mask."""
    runs = _uncompress(counts) if isinstance(counts, str) else counts
    if not isinstance(runs, list) or not all(type(run) is int and run >= 0 for run in runs):
        raise ValueError("counts that are neither text nor whole numbers of 0 or more")
    if sum(runs) != height_px * width_px:
        raise ValueError(f"counts that sum up to {sum(runs)} instead of {height_px * width_px}")
    return np.repeat(np.arange(len(runs)) % 2 > 0, runs).reshape(width_px, height_px).T


def _uncompress(text: str) -> list[int]:
    """Numbers of 5 bits a character, lowest first; from the fourth on each is the difference to the one before the last."""
    runs: list[int] = []
    value = shift = 0
    for character in text:
        bits = ord(character) - FIRST
        if not 0 <= bits < 64 or shift > MOST_BITS:
            raise ValueError(f"character {character!r} in compressed counts")
        value |= (bits & 31) << shift
        shift += 5
        if not bits & 32:
            value -= (1 << shift) if bits & 16 else 0
            runs.append(value + (runs[-2] if len(runs) > 2 else 0))
            value = shift = 0
    return runs
