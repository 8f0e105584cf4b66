"""From what the views say to the surface: probability of faces, labels of points, N_t, distances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from afford.common.geometry import farthest_point_sampling, sample_surface
from afford.surface.negative.distance import field
from afford.surface.negative.fuse import by_task, pixels
from afford.surface.negative.neighbours import fill
from afford.surface.negative.votes import squareness, vote
from schemas.mesh import ObjectMesh, ObjectViews
from schemas.surface import NegativeAffordance, NegativeAffordances, PartCandidates, PartDescriptions, PartScores

DENSE = 20
"""points that are drawn for each of N_t, so that the farthest of them cover the region"""


@dataclass(frozen=True)
class Wish:
    """What is asked of the result."""

    threshold: float
    points: int
    negative_points: int
    spacing_m: float
    margin_m: float
    seed: int


def project(mesh: ObjectMesh, views: ObjectViews, candidates: PartCandidates, descriptions: PartDescriptions, scores: PartScores,
            wish: Wish) -> NegativeAffordances:  # fmt: skip
    """Where a hand must not go, for every task that is described."""
    points, face = sample_surface(mesh.vertices, mesh.faces, views.visible_area, wish.points, np.random.default_rng(wish.seed))
    square, tasks = squareness(mesh, views), []
    for one, said in by_task(descriptions, scores):
        value, weight = pixels(candidates, said, one, views.face)
        probability, evidence = on_faces(mesh, views, value, weight * square)
        tasks.append(labelled(mesh, views, one.task, probability, evidence, face, wish))
    return NegativeAffordances(mesh.name, points, tuple(tasks))


def on_faces(mesh: ObjectMesh, views: ObjectViews, value: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What pixels say (n, h, w) with weights (n, h, w) -> probability (f,) of every face, and the sum of its weights (f,); a face
    without any takes what its neighbours have.
    """
    voted, evidence = vote(views.face, value, weight, len(mesh.faces))
    return fill(mesh.vertices, mesh.faces, voted, evidence > 0), evidence


def labelled(mesh: ObjectMesh, views: ObjectViews, task: str, probability: np.ndarray, evidence: np.ndarray, face: np.ndarray,
             wish: Wish) -> NegativeAffordance:  # fmt: skip
    """Probabilities of faces (f,) -> everything that is told of a task; `face` (n,) is that of each point of the object."""
    bad = probability > wish.threshold
    rng = np.random.default_rng((wish.seed, 1))
    dense, _ = sample_surface(mesh.vertices, mesh.faces, np.where(bad, views.visible_area, 0), DENSE * wish.negative_points, rng)
    N_t = dense[farthest_point_sampling(dense, wish.negative_points)]
    grid = field(mesh.name, N_t, mesh.vertices, wish.spacing_m, wish.margin_m)
    return NegativeAffordance(task, probability, evidence, bad[face], N_t, grid)
