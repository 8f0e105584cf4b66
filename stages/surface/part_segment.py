"""Segment a mesh into the parts that are described for it.

Reads   ObjectMesh, MeshParts (labels of its file, if any), ObjectViews, PartCandidates, PartDescriptions and PartScores of one
        object
Writes  MeshParts: the part of every face; the labels of the file where it has any; no part where none is described
Method  the votes of the negative affordance, for every part alone: each face takes the most probable part
Fails   when the inputs are not of one object, or a parameter is out of range
Paper   AffordDex segments negative parts only; parts of a body are needed for its hulls and for the choice of the grasp
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.mesh import MeshParts, ObjectMesh, ObjectViews
from schemas.surface import PartCandidates, PartDescriptions, PartScores

LIBRARIES = ("numpy", "scipy", "opencv-python-headless")
THREADS = 1
MEMORY_GIB = 1.0


@dataclass(frozen=True)
class Params:
    """Parameters of `part_segment`."""

    least_share: float = 0.005
    """parts on less than this share of the surface are dropped"""


def run(mesh: ObjectMesh, parts: MeshParts, views: ObjectViews, candidates: PartCandidates, descriptions: PartDescriptions,
        scores: PartScores, params: Params) -> MeshParts:  # fmt: skip
    """Segment one object."""
    from afford.surface.negative.segment import segment

    expected, faces = (len(candidates.view), len(descriptions.notes)), len(mesh.faces)
    if scores.share.shape != expected or len(views.visible_area) != faces or len(parts.part) != faces:
        raise ValueError(f"{mesh.name}: expected scores {expected} and views and parts of {faces} faces, got {scores.share.shape}, "
                         f"{len(views.visible_area)} and {len(parts.part)}; all inputs must be of one object")
    if not 0 <= params.least_share < 1:
        raise ValueError(f"part_segment.least_share: expected 0 or more and less than 1, got {params.least_share:g}")
    return segment(mesh, parts, views, candidates, descriptions, scores, params.least_share)
