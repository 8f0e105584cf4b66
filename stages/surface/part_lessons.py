"""Build training samples of the part scorer from an object with known parts.

Reads   ObjectSpec (for its split); ObjectMesh, MeshParts, ObjectViews and PartCandidates of one object
Writes  PartLessons: inputs of the scorer for each candidate, and the true share of each part
Method  at most `most` random candidates, so that all objects have the same weight
Fails   when the object has no candidate
Paper   replaces CLIP's training for the embedded scorer
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
    """Parameters of `part_lessons`."""

    most: int = 60
    """largest number of candidates of an object"""
    seed: int = 0
    """seed of the selection"""


def run(spec: ObjectSpec, mesh: ObjectMesh, parts: MeshParts, views: ObjectViews, candidates: PartCandidates,
        params: Params) -> PartLessons:  # fmt: skip
    """Build the training samples of one object."""
    from afford.surface.score.samples import part_samples

    return part_samples(spec, mesh, parts, views, candidates, params.most, params.seed)
