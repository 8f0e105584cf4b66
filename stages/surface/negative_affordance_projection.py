"""Project scored candidates of all views to negative affordance on the surface.

Reads   ObjectMesh, ObjectViews, PartCandidates, PartDescriptions and PartScores of one object
Writes  NegativeAffordances: for each task the probability of every face, labels of points, N_t, and a distance grid
Method  each pixel votes on the exact face behind it, weighted by the cosine of incidence and the certainty of the candidates;
        unseen faces take the values of their neighbours; N_t is a farthest point sample
Fails   when the inputs are not of one object
Paper   AffordDex, negative affordance: one mask in each of six views, points splatted into a coarse z-buffer, the union of all
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

from schemas.mesh import ObjectMesh, ObjectViews
from schemas.surface import NegativeAffordances, PartCandidates, PartDescriptions, PartScores

LIBRARIES = ("numpy", "scipy", "opencv-python-headless", "embreex")
THREADS = 1
MEMORY_GIB = 1.0


@dataclass(frozen=True)
class Params:
    """Parameters of `negative_affordance_projection`."""

    threshold: float = 0.35
    """probability above which a face is negative"""
    points: int = 2048
    """labelled points of the object"""
    negative_points: int = 100
    """points of N_t; AffordDex's metric uses 100"""
    spacing_m: float = 0.005
    """spacing of the distance grid"""
    margin_m: float = 0.05
    """margin of the distance grid around the object"""
    seed: int = 0
    """seed of the points"""


def run(mesh: ObjectMesh, views: ObjectViews, candidates: PartCandidates, descriptions: PartDescriptions, scores: PartScores,
        params: Params) -> NegativeAffordances:  # fmt: skip
    """Project the candidates of all views on the surface."""
    from afford.surface.negative.project import ProjectionSettings, project

    expected, faces = (len(candidates.view), len(descriptions.notes)), len(mesh.faces)
    if scores.share.shape != expected or len(views.visible_area) != faces:
        raise ValueError(f"{mesh.name}: expected scores {expected} and views of {faces} faces, got {scores.share.shape} and "
                         f"{len(views.visible_area)}; all inputs must be of one object")
    return project(mesh, views, candidates, descriptions, scores, ProjectionSettings(**asdict(params)))
