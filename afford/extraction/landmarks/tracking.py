"""Hand tracking as in MediaPipe's video mode: regions of the last frame's landmarks, and palms only while hands are missing.

Each frame depends on the one before. A tracked hand stays until its presence falls below the threshold.
"""

from __future__ import annotations

import numpy as np

from afford.extraction.landmarks.landmarks import HandLandmarker, Landmarks
from afford.extraction.landmarks.palm import PalmDetector, box_iou
from afford.extraction.landmarks.region import Region

SAME = 0.5
"""intersection over union of upright boxes above which two regions contain the same hand"""


class HandTracker:
    """Landmarks of up to `max_hands` hands in consecutive frames of one video."""

    def __init__(self, detector: PalmDetector, landmarker: HandLandmarker, max_hands: int = 2, min_score: float = 0.5,
                 min_presence: float = 0.5) -> None:  # fmt: skip
        self._detector, self._landmarker = detector, landmarker
        self._max_hands, self._min_score, self._min_presence = max_hands, min_score, min_presence
        self._regions: list[Region] = []

    def track(self, rgb: np.ndarray) -> list[Landmarks]:
        """Compute the landmarks of the hands in the next frame (h, w, 3) uint8: new hands first, then tracked ones."""
        regions = self._regions
        if len(regions) < self._max_hands:
            palms = self._detector.detect(rgb, self._min_score)[: self._max_hands]
            regions = distinct([palm.region() for palm in palms] + regions)
        found = [self._landmarker.landmarks(rgb, region) for region in regions]
        hands = [hand for hand in found if hand.presence > self._min_presence]
        self._regions = [hand.next_region() for hand in hands]
        return hands

    def reset(self) -> None:
        """Start again, as at a cut or for a still picture."""
        self._regions = []


def distinct(regions: list[Region]) -> list[Region]:
    """Drop every region that a later one contains, by the overlap of their upright boxes."""
    kept: list[Region] = []
    for region in regions:
        kept = [other for other in kept if not box_iou(_box(region), _box(other)[None])[0] > SAME]
        kept.append(region)
    return kept


def _box(region: Region) -> np.ndarray:
    """Corners (2, 2) of a region as if it were not rotated, as in the library."""
    centre = np.array([region.x_px, region.y_px])
    return np.stack([centre - region.side_px / 2, centre + region.side_px / 2])
