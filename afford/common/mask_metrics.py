"""Measures between two masks. Masks are (h, w) bool of the same shape; an empty pair has no score and gives NaN, but for `iou`."""

from __future__ import annotations

import cv2
import numpy as np

NAN = float("nan")


def region_similarity(found: np.ndarray, truth: np.ndarray) -> float:
    """J, the intersection over union (Perazzi et al. 2016). 0 when one of them is empty, NaN when both are."""
    union = np.count_nonzero(found | truth)
    return np.count_nonzero(found & truth) / union if union else NAN


def iou(found: np.ndarray, truth: np.ndarray) -> float:
    """The same, and 0 when both are empty."""
    union = np.count_nonzero(found | truth)
    return np.count_nonzero(found & truth) / union if union else 0.0


def precision(found: np.ndarray, truth: np.ndarray) -> float:
    """Share of the found pixels that are true. 0 when nothing is found but something is true, NaN when both are empty."""
    count = np.count_nonzero(found)
    if count == 0:
        return 0.0 if truth.any() else NAN
    return np.count_nonzero(found & truth) / count


def recall(found: np.ndarray, truth: np.ndarray) -> float:
    """Share of the true pixels that are found. 0 when nothing is true but something is found, NaN when both are empty."""
    return precision(truth, found)


def boundary(mask: np.ndarray) -> np.ndarray:
    """Pixels of the mask that have a 4-neighbour outside it; the image border does not count as outside. (h, w) bool."""
    padded = np.pad(mask, 1, mode="edge")
    inner = padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:]
    return mask & ~inner


def boundary_f(found: np.ndarray, truth: np.ndarray, tolerance_px: int = 2) -> float:
    """F, the harmonic mean of boundary precision and recall (Perazzi et al. 2016).

    A boundary pixel counts when the other boundary lies within a disc of radius `tolerance_px`. A mask that fills the whole
    image has no boundary. 0 when only one of the masks has a boundary; NaN when both masks are empty.
    """
    if not found.any() and not truth.any():
        return NAN
    edge_found, edge_truth = boundary(found), boundary(truth)
    if not edge_found.any() or not edge_truth.any():
        return float(not edge_found.any() and not edge_truth.any())
    disc = _disc(tolerance_px)
    near_truth = cv2.dilate(edge_truth.view(np.uint8), disc) > 0
    near_found = cv2.dilate(edge_found.view(np.uint8), disc) > 0
    hit = np.count_nonzero(edge_found & near_truth) / np.count_nonzero(edge_found)
    covered = np.count_nonzero(edge_truth & near_found) / np.count_nonzero(edge_truth)
    return 2 * hit * covered / (hit + covered) if hit + covered else 0.0


def _disc(radius_px: int) -> np.ndarray:
    y, x = np.mgrid[-radius_px : radius_px + 1, -radius_px : radius_px + 1]
    return (x * x + y * y <= radius_px * radius_px).astype(np.uint8)
