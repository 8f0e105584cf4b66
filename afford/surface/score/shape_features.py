"""Shape features of candidates in 3-D, invariant to rotation and scale, and traits of their masks.

The features quantify words such as long, thin, flat or at the end, for any object.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from afford.surface.face_features import FaceFeatures
from schemas.mesh import ObjectViews
from schemas.surface import PartCandidates

SHAPE_FEATURES = ("area", "length", "width", "depth", "width_to_length", "depth_to_length", "depth_to_width", "along", "aside_1",
        "aside_2", "aside_3", "nearer_end", "farther_end", "of_width", "of_depth", "thickness", "thickness_spread",
        "thickness_to_length", "flatness", "roundness", "bulge", "filled", "object_width", "object_depth")  # fmt: skip
LIMIT = 2.0


@dataclass(frozen=True, eq=False)
class OrientedBox:
    """Oriented bounding box of faces along their principal axes, the axis of the largest extent first.

    Weights (f,), `middle` (3,), axes (3, 3) in columns, lowest and highest coordinates (3,) along them.
    """

    weight: np.ndarray
    middle: np.ndarray
    axes: np.ndarray
    low: np.ndarray
    high: np.ndarray

    @staticmethod
    def of(points: np.ndarray, area: np.ndarray) -> OrientedBox:
        """Fit the box to the centres (f, 3) of faces with areas (f,)."""
        weight = np.maximum(area, 1e-14)
        weight = weight / weight.sum()
        middle = weight @ points
        off = points - middle
        axes = np.linalg.eigh((off * weight[:, None]).T @ off)[1]
        along = off @ axes
        low, high = along.min(0), along.max(0)
        order = np.argsort(low - high, kind="stable")
        return OrientedBox(weight, middle, axes[:, order], low[order], high[order])

    @property
    def size(self) -> np.ndarray:
        """Extents (3,), descending."""
        return self.high - self.low


def shape_features(features: FaceFeatures, views: ObjectViews, candidates: PartCandidates) -> np.ndarray:
    """Compute the features of the faces behind each mask: (m, r) float32, one column for each of SHAPE_FEATURES, -2..2."""
    area = np.asarray(views.visible_area, np.float64)
    seen = area > 0
    whole = OrientedBox.of(features.middle[seen], area[seen])
    out = np.zeros((len(candidates.view), len(SHAPE_FEATURES)), np.float32)
    for row, view, mask in zip(out, candidates.view, candidates.masks, strict=True):
        face = np.unique(views.face[view][mask])
        row[:] = np.clip(_numbers(features, face[face >= 0], whole, float(area.sum())), -LIMIT, LIMIT)
    return out


def _numbers(features: FaceFeatures, face: np.ndarray, whole: OrientedBox, visible: float) -> list[float]:
    """Compute the columns of one candidate; logarithms are scaled to about -1..1."""
    points, normal, area = features.middle[face], features.normal[face], features.area[face]
    longest = float(whole.size[0])
    patch = OrientedBox.of(points, area)
    long, wide, deep = np.maximum(patch.size, 1e-4 * longest)
    return [np.log(area.sum() / visible) / 3 + 0.5, np.log(long / longest) / 2 + 0.5, np.log(wide / longest) / 3 + 0.5,
            np.log(deep / longest) / 3 + 0.5, wide / long, deep / long, deep / wide, *_place(points, patch, whole),
            *_thickness(features.thickness[face], patch, longest), *_bend(points, normal, patch), area.sum() / (long * wide),
            whole.size[1] / longest, whole.size[2] / longest]  # fmt: skip


def _place(points: np.ndarray, patch: OrientedBox, whole: OrientedBox) -> list[float]:
    """Compute the position of a candidate in the object.

    Alignment with the object's axis, distances from its centre and both ends, and shares of its width and depth.
    """
    where = (points - whole.middle) @ whole.axes
    low, high = where.min(0), where.max(0)
    aside = np.abs(patch.weight @ where - (whole.low + whole.high) / 2) / np.maximum(whole.size / 2, 1e-9)
    ends = sorted([low[0] - whole.low[0], whole.high[0] - high[0]])
    taken = (high - low)[1:] / np.maximum(whole.size[1:], 1e-9)
    return [abs(float(patch.axes[:, 0] @ whole.axes[:, 0])), *aside, *(np.array(ends) / whole.size[0]), *taken]


def _thickness(thickness: np.ndarray, patch: OrientedBox, longest: float) -> list[float]:
    log = np.log(thickness / longest)
    mean = float(patch.weight @ log)
    spread = np.sqrt(patch.weight @ (log - mean) ** 2)
    return [mean / 3 + 1, spread, (mean + np.log(longest / max(patch.size[0], 1e-4 * longest))) / 3 + 0.5]


def _bend(points: np.ndarray, normal: np.ndarray, patch: OrientedBox) -> list[float]:
    """Compute the spread of the normals in two directions, and convexity.

    0, 0 for a plane; 0, more for a cylinder. Convexity is positive for a bulge and negative for a hollow.
    """
    spread = np.linalg.eigvalsh((normal * patch.weight[:, None]).T @ normal)
    bulge = patch.weight @ ((points - patch.middle) * normal).sum(1) / max(patch.size[0], 1e-12)
    return [3 * float(spread[0]), 2 * float(spread[1]), 2 * float(bulge)]


def mask_traits(views: ObjectViews, candidates: PartCandidates, thickness: np.ndarray) -> np.ndarray:
    """Compute four traits of each mask: (m, 4) float32, about -1..1.

    Share of the visible object, elongation of the mask, thickness (f,) behind the mask relative to the whole view, and quality.
    """
    out = np.zeros((len(candidates.view), 4), np.float32)
    log = np.append(np.log(thickness), 0.0)
    for n, (view, mask) in enumerate(zip(candidates.view, candidates.masks, strict=True)):
        face = views.face[view]
        on = face >= 0
        thicker = (log[face[mask]].mean() - log[face[on]].mean()) / 3
        out[n] = mask.sum() / max(on.sum(), 1), _elongation(mask), thicker, candidates.quality[n]
    return out


def _elongation(mask: np.ndarray) -> float:
    """Return 0 for a mask that is as wide as long, towards 1 for a needle."""
    y, x = np.nonzero(mask)
    if len(x) < 3:
        return 0.0
    small, large = np.linalg.eigvalsh(np.cov(np.stack([x, y]).astype(np.float64)) + 1e-6 * np.eye(2))
    return float(1 - np.sqrt(small / large))
