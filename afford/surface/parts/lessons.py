"""Candidates as the scorer sees them, with and without what they show in truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from afford.surface.parts.crops import CHANNELS, SIZE, MaskCropper
from afford.surface.parts.form import shape_features
from afford.surface.parts.traits import mask_traits
from afford.surface.segments.features import FaceFeatures
from schemas.mesh import MeshParts, ObjectMesh, ObjectSpec, ObjectViews
from schemas.surface import PartCandidates, PartLessons


def scorer_inputs(mesh: ObjectMesh, views: ObjectViews, candidates: PartCandidates) -> tuple[np.ndarray, np.ndarray]:
    """(m, 2, c, s, s) uint8 crops and (m, r) float32 numbers (traits.py, form.py) of all candidates."""
    cut, features = MaskCropper(mesh, views), FaceFeatures.of(mesh)
    crops = [cut(int(view), mask) for view, mask in zip(candidates.view, candidates.masks, strict=True)]
    empty = np.zeros((0, 2, len(CHANNELS), SIZE, SIZE), np.uint8)
    numbers = np.hstack([mask_traits(views, candidates, features.thickness), shape_features(features, views, candidates)])
    return np.stack(crops) if crops else empty, numbers


def part_samples(spec: ObjectSpec, mesh: ObjectMesh, parts: MeshParts, views: ObjectViews, candidates: PartCandidates, most: int,
            seed: int) -> PartLessons:  # fmt: skip
    """Some of the candidates with the truth; ValueError when there is none."""
    if not len(candidates.view):
        raise ValueError(f"{mesh.name}: expected candidates to learn from, got none")
    rng = np.random.default_rng((seed, spec.seed))
    chosen = np.sort(rng.permutation(len(candidates.view))[:most])
    some = replace(candidates, view=candidates.view[chosen], masks=candidates.masks[chosen], quality=candidates.quality[chosen])
    inputs, targets = scorer_inputs(mesh, views, some), part_targets(parts, views, some)
    return PartLessons(mesh.name, spec.category, spec.split, parts.names, *inputs, *targets)


def part_targets(parts: MeshParts, views: ObjectViews, candidates: PartCandidates) -> tuple[np.ndarray, np.ndarray]:
    """(m, p) float32 share of each candidate's pixels that show each part, and its IoU with what the view shows of the part."""
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
