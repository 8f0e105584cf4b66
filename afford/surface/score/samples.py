"""Inputs and training samples of the part scorer: crops of candidates, and their true part shares.

Each candidate has a close crop around the mask and a crop of the whole view, with six channels: brightness with a blurred surround
(as the paper shows masks to CLIP), mask, object, and normals in the camera frame. Colours are left out, because they say little
about parts, and less about objects outside the training set.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from afford.render.views.surface import face_areas
from afford.surface.face_features import FaceFeatures
from afford.surface.score.shape_features import mask_traits, shape_features
from schemas.mesh import MeshParts, ObjectMesh, ObjectSpec, ObjectViews
from schemas.surface import PartCandidates, PartLessons

SIZE = 48
CHANNELS = ("brightness", "mask", "object", "normal_x", "normal_y", "normal_z")
MARGIN = 0.35
"""margin around the mask in the close crop, as a share of the mask's longer side"""
BLUR = 0.1
"""sigma of the blurred surround, as a share of the view's side"""
EVEN = 128
"""uint8 value of a normal component 0"""


class MaskCropper:
    """Cropper for the views of one object; what all masks of a view share is computed once."""

    def __init__(self, mesh: ObjectMesh, views: ObjectViews) -> None:
        normal = face_areas(mesh.vertices[mesh.faces].astype(np.float64))[1]
        self._normal, self._views, self._base = np.vstack([normal, [[0, 0, 0]]]), views, dict[int, np.ndarray]()

    def __call__(self, view: int, mask: np.ndarray) -> np.ndarray:
        """Crop a mask (h, w) bool: (2, 6, SIZE, SIZE) uint8, close crop and whole view."""
        if view not in self._base:
            self._base[view] = self._whole(view)
        base = self._base[view]
        shown = np.dstack([np.where(mask, base[..., 0], base[..., 1]), _ink(mask), base[..., 2:]])
        return np.stack([_cut(shown, *_around(mask, MARGIN)), _cut(shown, *_around(base[..., 2] > 0, 0.04))])

    def _whole(self, view: int) -> np.ndarray:
        """Compute the channels of a view (h, w, 6) uint8: brightness, blurred brightness, object, normals."""
        rgb, face = self._views.rgb[view], self._views.face[view]
        grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
        blurred = cv2.GaussianBlur(grey, (0, 0), BLUR * grey.shape[1])
        facing = self._normal[face] @ self._views.T_obj_cam[view][:3, :3]
        facing *= np.where(facing[..., 2:] > 0, -1, 1)
        return np.dstack([grey, blurred, _ink(face >= 0), np.rint(EVEN + 127 * facing).astype(np.uint8)])


def rotate_crops(crops: np.ndarray, turn: int, mirror: bool) -> np.ndarray:
    """Rotate crops (..., 6, s, s) by `turn` quarter turns counter-clockwise, and mirror them, with their normals."""
    out = np.rot90(crops, turn, (-2, -1))
    x, y = out[..., 3, :, :], out[..., 4, :, :]
    for _ in range(turn % 4):
        x, y = y, 2 * EVEN - x.astype(np.int16)
    if mirror:
        out, x, y = out[..., ::-1], 2 * EVEN - x[..., ::-1].astype(np.int16), y[..., ::-1]
    out = np.array(out)
    out[..., 3, :, :], out[..., 4, :, :] = np.clip(x, 0, 255), np.clip(y, 0, 255)
    return out


def _ink(mask: np.ndarray) -> np.ndarray:
    return np.where(mask, np.uint8(255), np.uint8(0))


def _around(mask: np.ndarray, margin: float) -> tuple[float, float, float]:
    """Return centre x, y and side of a square around a mask, with a margin relative to the mask's longer side."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    side = max(rows[-1] - rows[0], columns[-1] - columns[0]) + 1
    return (columns[0] + columns[-1]) / 2, (rows[0] + rows[-1]) / 2, side * (1 + 2 * margin)


def _cut(shown: np.ndarray, x: float, y: float, side: float) -> np.ndarray:
    """Crop and resize a square (6, SIZE, SIZE) uint8; outside the image it is empty."""
    half, height, width = side / 2, *shown.shape[:2]
    low = np.floor([y - half + 0.5, x - half + 0.5]).astype(int)
    high = low + max(1, round(side))
    pad = [(max(0, -low[k]), max(0, high[k] - (height, width)[k])) for k in range(2)]
    inside = shown[max(0, low[0]) : high[0], max(0, low[1]) : high[1]]
    halves = [np.ascontiguousarray(inside[..., part]) for part in (slice(0, 3), slice(3, 6))]
    squares = [cv2.copyMakeBorder(part, *pad[0], *pad[1], cv2.BORDER_CONSTANT, value=[beyond] * 3)
               for part, beyond in zip(halves, (0, EVEN), strict=True)]  # fmt: skip
    small = [cv2.resize(square, (SIZE, SIZE), interpolation=cv2.INTER_AREA) for square in squares]
    return np.ascontiguousarray(np.dstack(small).transpose(2, 0, 1))


def scorer_inputs(mesh: ObjectMesh, views: ObjectViews, candidates: PartCandidates) -> tuple[np.ndarray, np.ndarray]:
    """Compute crops (m, 2, c, s, s) uint8 and scalar features (m, r) float32 of all candidates."""
    cut, features = MaskCropper(mesh, views), FaceFeatures.of(mesh)
    crops = [cut(int(view), mask) for view, mask in zip(candidates.view, candidates.masks, strict=True)]
    empty = np.zeros((0, 2, len(CHANNELS), SIZE, SIZE), np.uint8)
    numbers = np.hstack([mask_traits(views, candidates, features.thickness), shape_features(features, views, candidates)])
    return np.stack(crops) if crops else empty, numbers


def part_samples(spec: ObjectSpec, mesh: ObjectMesh, parts: MeshParts, views: ObjectViews, candidates: PartCandidates, most: int,
            seed: int) -> PartLessons:  # fmt: skip
    """Build training samples from at most `most` random candidates; ValueError without candidates."""
    if not len(candidates.view):
        raise ValueError(f"{mesh.name}: no candidate masks; check mask_propose")
    rng = np.random.default_rng((seed, spec.seed))
    chosen = np.sort(rng.permutation(len(candidates.view))[:most])
    some = replace(candidates, view=candidates.view[chosen], masks=candidates.masks[chosen], quality=candidates.quality[chosen])
    inputs, targets = scorer_inputs(mesh, views, some), part_targets(parts, views, some)
    return PartLessons(mesh.name, spec.category, spec.split, parts.names, *inputs, *targets)


def part_targets(parts: MeshParts, views: ObjectViews, candidates: PartCandidates) -> tuple[np.ndarray, np.ndarray]:
    """Compute the share (m, p) float32 of each candidate that shows each part, and its IoU with the visible part."""
    count = len(parts.names)
    part = np.append(parts.part, -1)[views.face]
    whole = np.stack([np.bincount(shown[shown >= 0], minlength=count) for shown in part]).astype(np.float64)
    both = np.zeros((len(candidates.view), count))
    for row, view, mask in zip(both, candidates.view, candidates.masks, strict=True):
        inside = part[view][mask]
        row[:] = np.bincount(inside[inside >= 0], minlength=count)
    size = candidates.masks.sum((1, 2))[:, None]
    union = whole[candidates.view] + size - both
    return (both / np.maximum(size, 1)).astype(np.float32), (both / np.maximum(union, 1)).astype(np.float32)
