"""an object with known parts, its views and candidates -> what the scorer of parts learns from it.

Reads   ObjectSpec (for its split); ObjectMesh, MeshParts, ObjectViews and PartCandidates of one object
Writes  PartLessons: candidates as the scorer sees them, and how much of each part they show in truth
Method  at most `most` candidates, drawn at random, so that no object counts more than another
Fails   when the object has no candidate
Paper   takes the place of CLIP's training for the embedded scorer
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.mesh import MeshParts, ObjectMesh, ObjectSpec, ObjectViews
from schemas.surface import PartCandidates, PartLessons

LIBRARIES = ("numpy", "opencv-python-headless", "embreex")
THREADS = 1
MEMORY_GIB = 0.5


@dataclass(frozen=True)
class Params:
    most: int = 60
    """candidates of an object"""
    seed: int = 0
    """seed of the draw"""


def run(spec: ObjectSpec, mesh: ObjectMesh, parts: MeshParts, views: ObjectViews, candidates: PartCandidates,
        params: Params) -> PartLessons:  # fmt: skip
    """Take the lessons of one object."""
    from afford.surface.score.samples import part_samples

    return part_samples(spec, mesh, parts, views, candidates, params.most, params.seed)
