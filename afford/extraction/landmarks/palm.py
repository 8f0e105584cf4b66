"""Palm detector: an SSD of MediaPipe on a square window of a picture, with weighted non-maximum suppression (NMS).

The steps are those of MediaPipe's PalmDetectionCpu 0.10.21: letterbox with black borders, anchors of fixed size, sigmoid of clipped
logits, NMS that averages overlapping boxes by score.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from afford.extraction.landmarks.region import Region, enlarged, upright_angle
from afford.extraction.landmarks.tflite import TfliteNetwork

INPUT_PX = 192
GRIDS = ((24, 2), (12, 6))
"""cells along a side of the feature maps, and anchors per cell"""
BOXES, SCORES = "Identity", "Identity_1"
"""outputs: (1, 2016, 18) centre, size and 7 points relative to the anchor in pixels of the input; (1, 2016, 1) logits"""
LOGIT_LIMIT = 100.0
OVERLAP = 0.3
"""intersection over union above which boxes are averaged"""
WRIST, MIDDLE = 0, 2
"""points of a palm: the wrist, and the first joint of the middle finger"""


@dataclass(frozen=True, eq=False)
class Palm:
    """A detected palm: box around the palm without fingers, and 7 points."""

    score: float
    """0..1"""
    box_px: np.ndarray
    """(4,) x0, y0, x1, y1 in the picture"""
    points_px: np.ndarray
    """(7, 2) wrist, first joints of index, middle, ring and little finger, two of the thumb"""

    def region(self) -> Region:
        """Region of the whole hand, with the fingers up."""
        low, high = self.box_px[:2], self.box_px[2:]
        angle = upright_angle(self.points_px[WRIST], self.points_px[MIDDLE])
        return enlarged((low + high) / 2, high - low, angle, scale=2.6, shift_y=-0.5)


class PalmDetector:
    """MediaPipe's palm detector, out of the file palm_detection_full.tflite."""

    def __init__(self, model: Path) -> None:
        self._network = TfliteNetwork(model)
        self._anchors = _anchors()

    def detect(self, rgb: np.ndarray, min_score: float = 0.5, window: tuple[float, float, float] | None = None) -> list[Palm]:
        """Detect palms in a picture (h, w, 3) uint8, best first, in pixels of the picture.

        window: x0, y0, side of the square that the network reads, in pixels; by default the square around the whole picture. The
        part outside the picture is black.
        """
        height, width = rgb.shape[:2]
        side = float(max(height, width))
        x0, y0, side = window or ((width - side) / 2, (height - side) / 2, side)
        square = Region(x0 + side / 2, y0 + side / 2, side)
        found = self._network(square.crop(rgb, INPUT_PX, cv2.BORDER_CONSTANT)[None])
        scores = 1 / (1 + np.exp(-found[SCORES].reshape(-1).clip(-LOGIT_LIMIT, LOGIT_LIMIT)))
        chosen = np.flatnonzero(scores >= min_score)
        points = _decode(found[BOXES].reshape(-1, 18)[chosen], self._anchors[chosen])
        sound = (points[:, 1] >= points[:, 0]).all(1)  # the library drops boxes of negative size
        return [Palm(score, square.to_picture(palm[:2]).reshape(4), square.to_picture(palm[2:]))
                for score, palm in weighted_nms(scores[chosen][sound], points[sound])]  # fmt: skip


def _anchors() -> np.ndarray:
    """Centres (2016, 2) float32 of the anchors, fractions of the input."""
    layers = []
    for cells, count in GRIDS:
        y, x = (np.mgrid[:cells, :cells] + 0.5) / cells
        layers.append(np.repeat(np.stack([x, y], -1).reshape(-1, 2), count, 0))
    return np.concatenate(layers).astype(np.float32)


def _decode(raw: np.ndarray, anchors: np.ndarray) -> np.ndarray:
    """Points (n, 9, 2) of boxes (n, 18), fractions of the input: upper left and lower right corner, then the 7 points."""
    values = raw.reshape(-1, 9, 2) / INPUT_PX
    centre, half = values[:, 0] + anchors, values[:, 1] / 2
    return np.concatenate([np.stack([centre - half, centre + half], 1), values[:, 2:] + anchors[:, None]], 1)


def weighted_nms(scores: np.ndarray, points: np.ndarray, overlap: float = OVERLAP) -> list[tuple[float, np.ndarray]]:
    """Average overlapping detections weighted by score, best first.

    scores: (n,). points: (n, k, 2), of which the first two are the corners of the box. Each group consists of the best remaining
    detection and those that overlap with its box by more than `overlap`; it keeps the score of the best.
    """
    rest, found = np.argsort(-scores, kind="stable"), []
    while len(rest):
        best = rest[0]
        near = box_iou(points[best, :2], points[rest, :2]) > overlap
        near[0] = True  # also a box without area, which overlaps with nothing
        group = rest[near]
        weights = scores[group] / scores[group].sum()
        found.append((float(scores[best]), np.tensordot(weights, points[group].astype(np.float64), 1)))
        rest = rest[~near]
    return found


def box_iou(box: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Intersection over union (n,) of a box (2, 2), corners, with others (n, 2, 2); 0 for boxes without area."""
    common = (np.minimum(box[1], others[:, 1]) - np.maximum(box[0], others[:, 0])).clip(0).prod(1)
    union = (box[1] - box[0]).prod() + (others[:, 1] - others[:, 0]).prod(1) - common
    return np.divide(common, union, out=np.zeros_like(common), where=union > 0)
