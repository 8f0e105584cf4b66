"""Binary masks: bounding boxes, morphology, nearest fill, and metrics of masks and images.

Masks are (h, w) bool. Metrics compare two masks of the same shape; a pair of empty masks gives NaN, except for `iou`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import cv2
import numpy as np

Box = tuple[slice, slice]
"""slices of rows and columns, so that `image[box(mask)]` is the crop; stops are exclusive"""

BORDER = 50 / 855
"""border of ActAffordance's crops, relative to the longer side of the image"""


def box(mask: np.ndarray, border_px: int | Sequence[int] = 0) -> Box:
    """Compute the bounding box of a mask, with a border that is clipped to the image.

    `border_px` is one width for all sides, or left, top, right, bottom. An empty mask gives empty slices.
    """
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not rows.size:
        return slice(0, 0), slice(0, 0)
    left, top, right, bottom = np.broadcast_to(border_px, 4).tolist()
    height, width = mask.shape
    return (slice(max(int(rows[0]) - top, 0), min(int(rows[-1]) + 1 + bottom, height)),
            slice(max(int(columns[0]) - left, 0), min(int(columns[-1]) + 1 + right, width)))


def dilate(mask: np.ndarray, radius_px: int) -> np.ndarray:
    """Dilate masks (h, w) or (t, h, w) bool by a disc. Radius 0 returns the mask itself."""
    return _morph(cv2.dilate, mask, radius_px)


def erode(mask: np.ndarray, radius_px: int) -> np.ndarray:
    """Erode masks (h, w) or (t, h, w) bool by a disc; the image border does not erode."""
    return _morph(cv2.erode, mask, radius_px)


def _morph(operation: Callable[..., np.ndarray], mask: np.ndarray, radius_px: int) -> np.ndarray:
    if radius_px == 0:
        return mask
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius_px + 1, 2 * radius_px + 1))
    if mask.ndim == 3:
        return np.stack([operation(one.view(np.uint8), disc) > 0 for one in mask]) if len(mask) else mask
    return operation(mask.view(np.uint8), disc) > 0


def fill_nearest(image: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Fill the unknown pixels of an image (h, w, c) with the nearest pixel that is `known` (h, w) bool."""
    _, label = cv2.distanceTransformWithLabels((~known).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    by_label = np.zeros((int(label.max()) + 1, image.shape[2]), image.dtype)
    by_label[label[known]] = image[known]
    return by_label[label]


NAN = float("nan")


def region_similarity(found: np.ndarray, truth: np.ndarray) -> float:
    """Compute J, the intersection over union (Perazzi et al. 2016).

    0 when one of the masks is empty, NaN when both are.
    """
    union = np.count_nonzero(found | truth)
    return np.count_nonzero(found & truth) / union if union else NAN


def iou(found: np.ndarray, truth: np.ndarray) -> float:
    """Compute the intersection over union; 0 when both masks are empty."""
    union = np.count_nonzero(found | truth)
    return np.count_nonzero(found & truth) / union if union else 0.0


def precision(found: np.ndarray, truth: np.ndarray) -> float:
    """Compute the share of the found pixels that are true.

    0 when only the found mask is empty, NaN when both are.
    """
    count = np.count_nonzero(found)
    if count == 0:
        return 0.0 if truth.any() else NAN
    return np.count_nonzero(found & truth) / count


def recall(found: np.ndarray, truth: np.ndarray) -> float:
    """Compute the share of the true pixels that are found.

    0 when only the true mask is empty, NaN when both are.
    """
    return precision(truth, found)


def boundary(mask: np.ndarray) -> np.ndarray:
    """Return the pixels (h, w) bool of a mask with a 4-neighbour outside it; the image border is not outside."""
    padded = np.pad(mask, 1, mode="edge")
    inner = padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:]
    return mask & ~inner


def boundary_f(found: np.ndarray, truth: np.ndarray, tolerance_px: int = 2) -> float:
    """Compute F, the harmonic mean of boundary precision and recall (Perazzi et al. 2016).

    A boundary pixel matches when the other boundary is within `tolerance_px`. A mask of the whole image has no boundary. The result
    is 0 when only one of the masks has a boundary and NaN when both masks are empty.
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


def psnr_db(found: np.ndarray, truth: np.ndarray, mask: np.ndarray | None = None) -> float:
    """Compute the peak signal-to-noise ratio of (h, w, 3) uint8 images in dB, inside `mask` (h, w) bool.

    NaN for an empty mask, infinity for equal pixels.
    """
    if mask is not None:
        found, truth = found[mask], truth[mask]
    if found.size == 0:
        return float("nan")
    error = float(np.mean((found.astype(np.float64) - truth.astype(np.float64)) ** 2))
    return float("inf") if error == 0 else 10.0 * float(np.log10(255.0**2 / error))
