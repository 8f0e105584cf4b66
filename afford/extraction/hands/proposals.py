"""Proposed regions of hands by colour: skin, and the colours of the hands that were found before in the same clip.

The palm detector misses hands that hold things or leave the picture; in a proposed region the landmark network recognises many.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from afford.extraction.hands.colours import BLUR_PX, COUNT, FLOOR_HAND, FLOOR_OTHER, MAX_ODDS, ClipColours, skin_preference
from afford.extraction.hands.refine import colour_bins, histogram_density
from afford.extraction.landmarks.geometry import draw_hand
from afford.extraction.landmarks.region import Region

SHRINK = 4
"""colours are compared in a picture that is smaller by this"""
SIZES = (0.04, 0.0625, 0.1, 0.165)
"""sizes of the proposed hands, as shares of the longer side of the picture"""
PER_SIZE = 3
LEAST = 0.25
"""least mean agreement of the colours, -0.3 to 1"""
AGAINST = -0.3
"""agreement of a pixel of other colours"""
SIDE = 2.2
"""side of a region, in sizes of the hand"""
CORE, TAKEN = 0.05, 0.3
"""radius of the bones whose colours are learned, and around which nothing is proposed, in sizes of the hand"""
LEAST_PX = 200
"""pixels of hands from which their colours are used"""


class HandColours:
    """Colours of the hands of a clip, learned as they are found."""

    def __init__(self) -> None:
        self._hand, self._other = np.zeros(COUNT), np.zeros(COUNT)

    def learn(self, rgb: np.ndarray, hands_px: Sequence[np.ndarray]) -> None:
        """Count the colours of certain hands, keypoints (21, 2) each, and of everything else in a picture."""
        bins = _bins(rgb)
        core = np.any([draw_hand(bins.shape, points / SHRINK, CORE) for points in hands_px], axis=0) & np.ones(bins.shape, bool)
        self._hand += ClipColours.counts(bins, core.astype(np.float32))
        self._other += ClipColours.counts(bins, (~core).astype(np.float32))

    def regions(self, rgb: np.ndarray, hands_px: Sequence[np.ndarray]) -> list[Region]:
        """Propose regions in a picture (h, w, 3) uint8, away from the hands (21, 2) that are known; fingers up or down."""
        bins, out = _bins(rgb), list[Region]()
        taken = [draw_hand(bins.shape, points / SHRINK, TAKEN) for points in hands_px]
        for agreement in (skin_preference(), self._agreement()):
            if agreement is None:
                continue
            like = np.clip(agreement[bins], AGAINST, 1).astype(np.float32)
            for mask in taken:
                like[mask] = AGAINST
            for x, y, size in _peaks(like):
                out += [Region(x, y, SIDE * size, angle) for angle in (0.0, -np.pi)]
        return out

    def _agreement(self) -> np.ndarray | None:
        """Agreement (n,) from -1 to 1 of every colour bin with the hands of the clip; None before any is known."""
        if self._hand.sum() < LEAST_PX:
            return None
        hand, other = (histogram_density(counts) for counts in (self._hand, self._other))
        odds = np.log(hand + FLOOR_HAND / COUNT) - np.log(other + FLOOR_OTHER / COUNT)
        return np.asarray(np.clip(odds / MAX_ODDS, -1, 1))


def _bins(rgb: np.ndarray) -> np.ndarray:
    size = (max(rgb.shape[1] // SHRINK, 16), max(rgb.shape[0] // SHRINK, 16))
    return colour_bins(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), BLUR_PX)


def _peaks(like: np.ndarray) -> list[tuple[float, float, float]]:
    """Places and sizes (x, y, size), px of the whole picture, where pixels of the right colours gather."""
    out = list[tuple[float, float, float]]()
    for share in SIZES:
        size = max(share * max(like.shape), 3)
        mean = cv2.GaussianBlur(like, (0, 0), 0.4 * size)
        for _ in range(PER_SIZE):
            y, x = np.unravel_index(int(mean.argmax()), mean.shape)
            if mean[y, x] < LEAST:
                break
            out.append(((float(x) + 0.5) * SHRINK, (float(y) + 0.5) * SHRINK, size * SHRINK))
            cv2.circle(mean, (int(x), int(y)), int(size), -1.0, -1)
    return out
