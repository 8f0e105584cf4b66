"""How well a two-hand model does on validation: at the size of the model, one truth per sample, strict definitions.

The benchmark (`twohands/benchmark`) measures more, and at the image's own size; here it must be quick, and choose a threshold.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from torch import Tensor

from afford.common.image_files import jpeg
from afford.common.palette import LEFT, RIGHT
from afford.twohands.model.hand_selection import select_hands
from afford.twohands.model.predictor import ranked

THRESHOLDS = tuple(round(0.05 * n, 2) for n in range(1, 20))


@dataclass(frozen=True)
class Validated:
    """What the model said of one sample, and what is true."""

    regions: np.ndarray
    """(k, 2, h, w) float32: probability inside the region of each hand that is used, 0 for an idle one; best ranked first"""
    truth: np.ndarray
    """(2, h, w) bool"""
    right: bool
    """whether the taxonomy is"""

    @classmethod
    def of(cls, probability: np.ndarray, score: Tensor, taxonomy: np.ndarray, truth: np.ndarray, label: int) -> Validated:
        """probability (2, k, h, w), score logits (2, k), taxonomy probabilities (4,)."""
        hands = select_hands(taxonomy)
        order = (-ranked(score, bool(hands.all())).numpy()).argsort(1, kind="stable")
        sorted_ = np.take_along_axis(probability, order[:, :, None, None], 1) * hands[:, None, None, None]
        return cls(sorted_.swapaxes(0, 1), truth, int(taxonomy.argmax()) == label)


def validation_metrics(said: Sequence[Validated]) -> dict[str, float]:
    """Means over samples: iou and precision of both hands' union at the threshold with the best iou, best_iou of the best of
    the k hypotheses there, taxonomy, threshold.
    """
    table = np.array([iou_and_precision(one.regions[0], one.truth) for one in said])
    iou, precision = table.mean(0)
    best = int(iou.argmax())
    several = [max(iou_and_precision(region, one.truth)[0][best] for region in one.regions) for one in said]
    return {"iou": float(iou[best]), "precision": float(precision[best]), "threshold": THRESHOLDS[best],
            "best_iou": float(np.mean(several)), "taxonomy": float(np.mean([one.right for one in said]))}


def iou_and_precision(region: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """(2, h, w) probabilities and truth -> (2, thresholds): IoU and precision of the union of both hands, 0 where the union of
    truth and prediction, or the prediction, is empty.
    """
    height, true = region.max(0), truth.any(0)
    found, hit = _above(height.ravel()), _above(height[true])
    union = np.maximum(found + np.count_nonzero(true) - hit, 1)
    return np.stack([hit / union, hit / np.maximum(found, 1)])


def _above(values: np.ndarray) -> np.ndarray:
    """How many values are above each threshold."""
    passed = np.searchsorted(np.array(THRESHOLDS, np.float32), values, side="left")
    return np.bincount(passed, minlength=len(THRESHOLDS) + 1)[::-1].cumsum()[::-1][1:]


COLUMNS, ROWS = 4, 3
OPACITY = 0.6


def write_preview(path: Path, asked: Sequence[tuple[np.ndarray, str]], said: Sequence[Validated]) -> None:
    """Write a JPEG of samples spread over all of them; `asked` are images (h, w, 3) uint8 and their tasks."""
    count = min(COLUMNS * ROWS, len(said))
    chosen = [round(n * (len(said) - 1) / max(count - 1, 1)) for n in range(count)]
    tiles = [tile(*asked[n], said[n]) for n in chosen]
    tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % COLUMNS)
    lines = [np.hstack(tiles[n : n + COLUMNS]) for n in range(0, len(tiles), COLUMNS)]
    path.write_bytes(jpeg(np.vstack(lines)))


def tile(image: np.ndarray, task: str, said: Validated) -> np.ndarray:
    """One sample, (h + 16, w, 3) uint8."""
    picture = image.astype(np.float32)
    for colour, region in zip((LEFT, RIGHT), said.regions[0], strict=True):
        weight = OPACITY * region[..., None]
        picture = picture * (1 - weight) + np.array(colour, np.float32) * weight
    drawn = np.ascontiguousarray(picture.round().astype(np.uint8))
    for colour, mask in zip((LEFT, RIGHT), said.truth, strict=True):
        outlines, _ = cv2.findContours(mask.view(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(drawn, outlines, -1, colour, 1)
    words = np.zeros((16, image.shape[1], 3), np.uint8)
    cv2.putText(words, task.encode("ascii", "replace").decode(), (2, 11), cv2.FONT_HERSHEY_SIMPLEX, 0.35, (255, 255, 255), 1)
    return np.vstack([drawn, words])
