"""Colour model of the hands of a clip: log odds of every colour bin, from pixels of hands and of their surroundings."""

from __future__ import annotations

from functools import cache

import numpy as np

from afford.extraction.hands.refine import BINS_LAB, colour_bins, histogram_density

COUNT = int(np.prod(BINS_LAB))
FLOOR_HAND, FLOOR_OTHER = 0.01, 0.06
"""density added to every bin, in units of a uniform density: a colour that was never measured is not a hand's"""
NEARBY = 0.6
"""weight of the surroundings of the hands against all of the clip, in the colours of everything else"""
MOSTLY = 0.45
"""share of a hand's pixels in skin colours from which skin colours are preferred: a glove has none"""
MAX_ODDS = 3.0
BLUR_PX = 0.8


class ClipColours:
    """Colour bins of every sampled frame of a clip."""

    def __init__(self, rgb: np.ndarray, elsewhere: np.ndarray) -> None:
        """rgb: (k, h, w, 3) uint8; elsewhere: (k, h, w) bool, pixels far from every hand."""
        self.bins = np.stack([colour_bins(picture, BLUR_PX) for picture in rgb])
        counts = self.counts(self.bins, elsewhere.astype(np.float32))
        self._elsewhere = counts / max(counts.sum(), 1.0)

    @staticmethod
    def counts(bins: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """Weighted count (n,) of the pixels of every colour bin."""
        return np.bincount(bins.ravel(), weights=weight.ravel(), minlength=COUNT)

    def odds(self, hand: np.ndarray, nearby: np.ndarray) -> np.ndarray:
        """Log odds (n,) float32 of a hand for every colour bin, from counts of pixels of hands and of their surroundings."""
        share = float(hand[skin_preference() > 0].sum() / max(hand.sum(), 1e-6))
        inside = histogram_density(hand)
        outside = histogram_density(NEARBY * nearby / max(nearby.sum(), 1.0) + (1 - NEARBY) * self._elsewhere)
        odds = np.log(inside + FLOOR_HAND / COUNT) - np.log(outside + FLOOR_OTHER / COUNT)
        if share > MOSTLY:
            odds = odds + np.where(skin_preference() < 0, 1.5, 0.3) * skin_preference()
        return np.clip(odds, -MAX_ODDS, MAX_ODDS).astype(np.float32)


@cache
def skin_preference() -> np.ndarray:
    """Preference (n,) float32 from -1.5 to 1 for colours of human skin under common light, by hue and chroma of CIE Lab.

    Skin of every tone has a hue near 50 degrees; lightness is left out.
    """
    _, a, b = np.mgrid[: BINS_LAB[0], : BINS_LAB[1], : BINS_LAB[2]]
    a, b = ((axis + 0.5) * 256 / BINS_LAB[1] - 128 for axis in (a, b))
    hue, chroma = np.degrees(np.arctan2(b, a)), np.hypot(a, b)
    off = np.clip(np.abs(hue - 50) / 35, 0, 3) ** 2 + np.clip((7 - chroma) / 6, 0, 2) ** 2 + np.clip((chroma - 45) / 15, 0, 2) ** 2
    return np.clip(1 - off, -1.5, 1).ravel().astype(np.float32)
