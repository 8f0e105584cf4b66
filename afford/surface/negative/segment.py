"""Part segmentation of a mesh: each face takes the part that wins the votes of all views.

The masks, scores and weights are those of the negative affordance (project.py). There the probability of all negative parts is
projected; here that of every part alone, and the most probable part is kept.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from afford.render.views.surface import face_areas
from afford.surface.negative.project import cos_incidence, pixel_probability, project_to_faces, split_by_task
from schemas.mesh import MeshParts, ObjectMesh, ObjectViews
from schemas.surface import PartCandidates, PartDescription, PartDescriptions, PartScores


def segment(mesh: ObjectMesh, known: MeshParts, views: ObjectViews, candidates: PartCandidates, descriptions: PartDescriptions,
            scores: PartScores, least_share: float) -> MeshParts:  # fmt: skip
    """Segment a mesh into its described parts; labels of a file (`known`) are kept where it has any.

    A part on less than `least_share` of the surface is dropped, and its faces take the next most probable part. An object without
    described parts has no part.
    """
    one, own = next(split_by_task(descriptions, scores))
    if known.names or not one.notes:
        return known
    square = cos_incidence(mesh, views)
    votes = np.stack([_probability(mesh, views, candidates, own, one, k, square) for k in range(len(one.notes))], axis=1)
    part = votes.argmax(axis=1)
    area = face_areas(mesh.vertices[mesh.faces].astype(np.float64))[0]
    kept = np.bincount(part, area, votes.shape[1]) >= least_share * area.sum()
    part = np.where(kept, votes, -1.0).argmax(axis=1)
    used = np.unique(part)
    names = tuple(one.notes[k].part for k in used)
    return MeshParts(mesh.name, names, np.searchsorted(used, part).astype(np.int16))


def _probability(mesh: ObjectMesh, views: ObjectViews, candidates: PartCandidates, scores: PartScores, description: PartDescription,
                 wanted: int, square: np.ndarray) -> np.ndarray:  # fmt: skip
    """Probability (f,) that a face belongs to part number `wanted` of the description."""
    notes = tuple(replace(note, role="negative" if k == wanted else "neutral") for k, note in enumerate(description.notes))
    value, weight = pixel_probability(candidates, scores, replace(description, notes=notes), views.face)
    return project_to_faces(mesh, views, value, weight * square)[0]
