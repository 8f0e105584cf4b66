"""Parameters of the search for hand landmarks."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Search:
    """Parameters of the search."""

    look_s: float = 0.1
    """seconds between two sampled frames"""
    width_px: int = 1280
    """frames are scaled down to fit into width_px x height_px, or height_px x width_px"""
    height_px: int = 720
    """see width_px"""
    min_palm: float = 0.2
    """least score of a detected palm"""
    min_presence: float = 0.3
    """least presence of a hand in its region, of those that are kept"""
    windows_every: int = 2
    """sampled frames between two searches in square windows as high as the picture and in one with a margin; 0: never"""
    fine_every: int = 4
    """sampled frames between two searches in windows half as high, in frames with fewer than two hands; 0: never"""
    colour_every: int = 4
    """sampled frames between two searches in regions of the colours of hands, in frames with fewer than two hands; 0: never"""
    min_proposed: float = 0.6
    """least presence of a hand in such a region"""
