"""Project the regions of a two-hand model from the views of an object on its faces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from afford.common.geometry import farthest_point_sampling, sample_surface
from afford.surface.negative.project import DENSE, cos_incidence, project_to_faces
from schemas.benchmark import Prediction
from schemas.mesh import ObjectMesh, ObjectViews
from schemas.surface import PositiveAffordance


@dataclass(frozen=True)
class ProjectionSettings:
    """Settings of the projection."""

    threshold: float
    points: int
    seed: int


def hand_probability(predictions: Sequence[Prediction]) -> np.ndarray:
    """Return the probability (2, n, h, w) float32 of each hand's likeliest region in each view; 0 for an unused hand."""
    best = [[one.probability[side, one.score[side].argmax()] * one.hands[side] for one in predictions] for side in (0, 1)]
    return np.array(best, np.float32)


def project(mesh: ObjectMesh, views: ObjectViews, task: str, predictions: Sequence[Prediction],
            settings: ProjectionSettings) -> PositiveAffordance:  # fmt: skip
    """Compute the positive affordance of one task from one prediction for each view."""
    each = hand_probability(predictions)
    square = cos_incidence(mesh, views)
    hands = [project_to_faces(mesh, views, value, square) for value in each]
    probability, evidence = project_to_faces(mesh, views, 1 - (1 - each).prod(0), square)
    good = probability > settings.threshold
    rng = np.random.default_rng((settings.seed, 2))
    dense, _ = sample_surface(mesh.vertices, mesh.faces, np.where(good, views.visible_area, 0), DENSE * settings.points, rng)
    taxonomy = np.asarray(np.mean([one.taxonomy for one in predictions], axis=0), np.float32)
    return PositiveAffordance(task, probability, np.stack([p for p, _ in hands]), evidence, taxonomy,
                              dense[farthest_point_sampling(dense, settings.points)])
