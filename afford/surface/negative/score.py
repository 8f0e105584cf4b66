"""Score negative surfaces of all methods against exact part labels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from afford.common.geometry import sample_surface
from afford.surface.negative import baselines
from afford.surface.negative.project import split_by_task
from schemas.mesh import MeshParts, ObjectMesh, ObjectViews
from schemas.surface import NegativeAffordances, NegativeScore, PartCandidates, PartDescriptions, PartScores

NAN = float("nan")
POINTS = 2048
"""points of the visible surface for point recall"""
METHODS = ("afford", "paper_recipe", "coarse_box", "clip_relevance", "whole_object", "random_candidate")


class ScoredMasks(NamedTuple):
    """Masks in the views of an object, and their scores for the described parts."""

    masks: PartCandidates
    scores: PartScores


class PartTruth(NamedTuple):
    """Ground truth of an object: part labels, and task -> names of its negative parts."""

    parts: MeshParts
    truth: dict[str, frozenset[str]]


def score(mesh: ObjectMesh, views: ObjectViews, descriptions: PartDescriptions, candidates: ScoredMasks, windows: ScoredMasks,
          found: NegativeAffordances, known: PartTruth, threshold: float, seed: int) -> tuple[NegativeScore, ...]:  # fmt: skip
    """Score all methods and tasks. Faces without a label do not count."""
    area = np.where(known.parts.part >= 0, views.visible_area, 0).astype(np.float64)
    face = sample_surface(mesh.vertices, mesh.faces, area, POINTS, np.random.default_rng(seed))[1]
    rows = list[NegativeScore]()
    by_task = (split_by_task(descriptions, one.scores) for one in (candidates, windows))
    each = zip(*by_task, found.tasks, strict=True)
    for (one, own), (_, fits), projected in each:
        true = np.isin(known.parts.part, [n for n, name in enumerate(known.parts.names) if name in known.truth[one.task]])
        taken = {
            "paper_recipe": baselines.paper_recipe(candidates.masks, one, own),
            "coarse_box": baselines.coarse_box_recipe(views, candidates.masks, windows.masks, one, fits),
            "random_candidate": baselines.random_candidate(candidates.masks, np.random.default_rng(seed)),
        }
        answers = {
            "afford": projected.probability > threshold,
            "clip_relevance": baselines.clip_relevance(mesh, views, windows.masks, one, fits),
            "whole_object": baselines.whole_object(mesh),
        } | {method: baselines.splat_masks(mesh, views, masks) for method, masks in taken.items()}
        whole = {method: baselines.whole_object_taken(views, masks) for method, masks in taken.items()}
        rows += [_row(method, one.task, answers[method], true, area, face, whole.get(method, NAN)) for method in METHODS]
    return tuple(rows)


def _row(method: str, task: str, marked: np.ndarray, true: np.ndarray, area: np.ndarray, face: np.ndarray,
         whole: float) -> NegativeScore:  # fmt: skip
    both, either, right, found = (float(area[m].sum()) for m in (marked & true, marked | true, true, marked))
    share = found / max(float(area.sum()), 1e-30)
    if not true[face].any():
        return NegativeScore(method, task, NAN, NAN, NAN, NAN, share, whole)
    points = float(marked[face][true[face]].mean())
    return NegativeScore(method, task, both / either, both / found if found else 0.0, both / right, points, share, whole)
