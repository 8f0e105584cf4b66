"""Score a negative surface against exact part labels, with baselines.

Reads   mesh, parts, views, descriptions, candidates and windows (mask_propose `grid`) of one object and the scores of both;
        NegativeAffordances; ObjectSpec of a procedural object
Writes  NegativeScores: IoU, precision, recall and point recall of every method and task, and how often a method that selects one
        mask in each view selects the whole object; a row of images
Method  faces are weighted by the area that is visible from outside. `paper_recipe` has the same candidates and scores, six views,
        one mask in each and a z-buffer of points; `coarse_box` puts a box around the windows that fit and selects the mask that
        fills it best; `clip_relevance` is the mean fit of the windows at each pixel; `whole_object` and `random_candidate` need
        no scorer
Fails   never: objects without labels, or outside the lexicon, have no scores
Paper   AffordDex evaluates grasps, not its negative affordances: these measures are ours
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.mesh import MeshParts, ObjectMesh, ObjectSpec, ObjectViews
from schemas.surface import NegativeAffordances, NegativeScores, PartCandidates, PartDescriptions, PartScores

LIBRARIES = ("numpy", "scipy", "opencv-python-headless")
THREADS = 1
MEMORY_GIB = 0.5


@dataclass(frozen=True)
class Params:
    """Parameters of `negative_affordance_score`."""

    threshold: float = 0.35
    """probability above which a face is negative; the pipeline passes that of negative_affordance_projection"""
    seed: int = 0
    """seed of the random candidate and of the scored points"""


def run(mesh: ObjectMesh, parts: MeshParts, views: ObjectViews, candidates: PartCandidates, descriptions: PartDescriptions,
        scores: PartScores, windows: PartCandidates, window_scores: PartScores, found: NegativeAffordances, params: Params,
        spec: ObjectSpec | None = None) -> NegativeScores:  # fmt: skip
    """Score one object; `spec` belongs to a procedural one."""
    from afford.common.image_files import encode_jpeg
    from afford.surface.describe.household import household_category, household_negative
    from afford.surface.negative.score import PartTruth, ScoredMasks, score
    from afford.surface.negative.score_report import QUALITY, sheet_row

    kind, split, look = household_category(mesh.category), spec.split if spec else "given", spec.look if spec else "given"
    true = {one.task: household_negative(kind, one.task) if kind else frozenset[str]() for one in descriptions.descriptions}
    rows = score(mesh, views, descriptions, ScoredMasks(candidates, scores), ScoredMasks(windows, window_scores), found,
                 PartTruth(parts, true), params.threshold, params.seed)  # fmt: skip
    six, every = float(views.seen_area[5]), float(views.seen_area[-1])
    title = f"{(kind or 'unknown').replace('_', ' ')}, {found.tasks[0].task or 'any use'}"
    measured = f"IoU {rows[0].iou:.2f}" if rows[0].iou == rows[0].iou else "no truth"
    picture = encode_jpeg(sheet_row(views, found, (title, mesh.name if spec is None else f"{split}, {look}", measured)), QUALITY)
    return NegativeScores(mesh.name, kind or "unknown", split, look, six, every, rows, picture)
