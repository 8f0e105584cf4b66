"""How well negative surfaces agree with exact part truth."""

from __future__ import annotations

import numpy as np

from afford.negative import baselines
from afford.negative.fuse import by_task
from afford.negative.points import sample
from schemas.mesh import MeshParts, ObjectMesh, ObjectViews
from schemas.negative import NegativeAffordances, NegativeScore, PartCandidates, PartDescriptions, PartScores

NAN = float("nan")
POINTS = 2048
"""points of the visible surface whose recall is counted"""
METHODS = ("afford", "paper_recipe", "whole_object", "random_candidate")


def score(mesh: ObjectMesh, parts: MeshParts, views: ObjectViews, candidates: PartCandidates, descriptions: PartDescriptions,
          scores: PartScores, found: NegativeAffordances, truth: dict[str, frozenset[str]], threshold: float,
          seed: int) -> tuple[NegativeScore, ...]:  # fmt: skip
    """Rows of all methods and tasks. `truth`: task -> names of its negative parts. Faces without a label do not count."""
    area = np.where(parts.part >= 0, views.visible_area, 0).astype(np.float64)
    face = sample(mesh.vertices, mesh.faces, area, POINTS, np.random.default_rng(seed))[1]
    rows = list[NegativeScore]()
    for (one, said), told in zip(by_task(descriptions, scores), found.tasks, strict=True):
        true = np.isin(parts.part, [n for n, name in enumerate(parts.names) if name in truth[one.task]])
        answers = {
            "afford": told.probability > threshold,
            "paper_recipe": baselines.paper(mesh, views, candidates, one, said),
            "whole_object": baselines.whole(mesh),
            "random_candidate": baselines.random_candidate(mesh, views, candidates, np.random.default_rng(seed)),
        }
        rows += [_row(method, one.task, answers[method], true, area, face) for method in METHODS]
    return tuple(rows)


def _row(method: str, task: str, said: np.ndarray, true: np.ndarray, area: np.ndarray, face: np.ndarray) -> NegativeScore:
    both, either, right, told = (float(area[m].sum()) for m in (said & true, said | true, true, said))
    share = told / max(float(area.sum()), 1e-30)
    if not true[face].any():
        return NegativeScore(method, task, NAN, NAN, NAN, NAN, share)
    points = float(said[face][true[face]].mean())
    return NegativeScore(method, task, both / either, both / told if told else 0.0, both / right, points, share)
