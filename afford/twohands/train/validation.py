"""Validation metrics of a two-hand model at its input size, with one truth for each sample; and preview sheets.

They are fast to compute and choose the threshold. The benchmark (`twohands/benchmark`) measures more, at the image's own size.
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
from afford.twohands.model.calibration import fit_calibration, fit_temperature, tempered
from afford.twohands.model.hand_selection import hand_probabilities, select_hands
from afford.twohands.model.predictor import rank_scores

THRESHOLDS = tuple(round(0.05 * n, 2) for n in range(1, 20))


@dataclass(frozen=True)
class ValidationSample:
    """Prediction for one validation sample, and its truth."""

    regions: np.ndarray
    """(k, 2, h, w) float32: probabilities of both hands, the top-ranked hypothesis first"""
    taxonomy: np.ndarray
    """(4,) probabilities"""
    truth: np.ndarray
    """(2, h, w) bool"""
    label: int
    """class of the taxonomy"""

    @classmethod
    def of(cls, probability: np.ndarray, score: Tensor, taxonomy: np.ndarray, truth: np.ndarray, label: int) -> ValidationSample:
        """Sort the hypotheses of probability (2, k, h, w) by their score logits (2, k), given taxonomy probabilities (4,)."""
        order = (-rank_scores(score, bool(select_hands(taxonomy).all())).numpy()).argsort(1, kind="stable")
        return cls(np.take_along_axis(probability, order[:, :, None, None], 1).swapaxes(0, 1), taxonomy, truth, label)

    @property
    def selected(self) -> np.ndarray:
        """(k, 2, h, w) float32: probabilities of each selected hand, 0 for the other."""
        return np.asarray(self.regions * select_hands(self.taxonomy)[:, None, None])


def validation_metrics(samples: Sequence[ValidationSample]) -> dict[str, float]:
    """Compute means over samples, at the threshold with the best mean IoU.

    `iou` and `precision` are those of the union of both hands, `best_iou` that of the best of the k hypotheses, `taxonomy` is the
    accuracy of the taxonomy, and `threshold` is that threshold. `temperature`, `slope` and `offset` calibrate the taxonomy and the
    regions (`fit_temperature`, `fit_calibration`).
    """
    regions = [one.selected for one in samples]
    table = np.array([iou_and_precision(own[0], one.truth) for own, one in zip(regions, samples, strict=True)])
    iou, precision = table.mean(0)
    best = int(iou.argmax())
    several = [max(iou_and_precision(each, one.truth)[0][best] for each in own) for own, one in zip(regions, samples, strict=True)]
    right = [int(one.taxonomy.argmax()) == one.label for one in samples]
    return {"iou": float(iou[best]), "precision": float(precision[best]), "threshold": THRESHOLDS[best],
            "best_iou": float(np.mean(several)), "taxonomy": float(np.mean(right)), **calibration_metrics(samples)}


def calibration_metrics(samples: Sequence[ValidationSample]) -> dict[str, float]:
    """Fit `temperature`, `slope` and `offset`."""
    taxonomy = np.stack([one.taxonomy for one in samples])
    temperature = fit_temperature(taxonomy, np.array([one.label for one in samples]))
    hands = [hand_probabilities(tempered(one, temperature)) for one in taxonomy]
    slope, offset = fit_calibration((one.regions[0, side].ravel(), one.truth[side].ravel(), float(hand[side]))
                                    for one, hand in zip(samples, hands, strict=True) for side in (0, 1))
    return {"temperature": temperature, "slope": slope, "offset": offset}


def iou_and_precision(region: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """IoU and precision (2, thresholds) of the union of both hands, from probabilities and truth (2, h, w).

    They are 0 where truth and prediction, or the prediction, are empty.
    """
    height, true = region.max(0), truth.any(0)
    found, hit = _above(height.ravel()), _above(height[true])
    union = np.maximum(found + np.count_nonzero(true) - hit, 1)
    return np.stack([hit / union, hit / np.maximum(found, 1)])


def _above(values: np.ndarray) -> np.ndarray:
    """Number of values above each threshold."""
    passed = np.searchsorted(np.array(THRESHOLDS, np.float32), values, side="left")
    return np.bincount(passed, minlength=len(THRESHOLDS) + 1)[::-1].cumsum()[::-1][1:]


COLUMNS, ROWS = 4, 3
OPACITY = 0.6


def write_preview(path: Path, inputs: Sequence[tuple[np.ndarray, str]], samples: Sequence[ValidationSample]) -> None:
    """Write a JPEG of evenly spaced samples; `inputs` are their images (h, w, 3) uint8 and tasks.

    Predictions are filled, truth is outlined, in the colours of the left and right hand.
    """
    count = min(COLUMNS * ROWS, len(samples))
    chosen = [round(n * (len(samples) - 1) / max(count - 1, 1)) for n in range(count)]
    tiles = [tile(*inputs[n], samples[n]) for n in chosen]
    tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % COLUMNS)
    lines = [np.hstack(tiles[n : n + COLUMNS]) for n in range(0, len(tiles), COLUMNS)]
    path.write_bytes(jpeg(np.vstack(lines)))


def tile(image: np.ndarray, task: str, sample: ValidationSample) -> np.ndarray:
    """Draw one sample with its task below, (h + 16, w, 3) uint8."""
    picture = image.astype(np.float32)
    for colour, region in zip((LEFT, RIGHT), sample.selected[0], strict=True):
        weight = OPACITY * region[..., None]
        picture = picture * (1 - weight) + np.array(colour, np.float32) * weight
    drawn = np.ascontiguousarray(picture.round().astype(np.uint8))
    for colour, mask in zip((LEFT, RIGHT), sample.truth, strict=True):
        outlines, _ = cv2.findContours(mask.view(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(drawn, outlines, -1, colour, 1)
    line = np.zeros((16, image.shape[1], 3), np.uint8)
    cv2.putText(line, task.encode("ascii", "replace").decode(), (2, 11), cv2.FONT_HERSHEY_SIMPLEX, 0.35, (255, 255, 255), 1)
    return np.vstack([drawn, line])
