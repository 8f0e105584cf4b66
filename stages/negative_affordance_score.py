"""a negative surface and exact part truth -> scores, beside those of simpler recipes.

Reads   ObjectSpec; mesh, parts, views, candidates, descriptions and scores of one object; NegativeAffordances
Writes  NegativeScores: IoU, precision, recall and point recall of every method and task; a row of pictures
Method  faces are weighted by the area that can be seen from outside; `paper_recipe` has the same candidates and scores, six views,
        one mask in each and a z-buffer of points; `whole_object` and `random_candidate` need no scorer
Fails   when the table has no such category
Paper   AffordDex evaluates grasps, not its negative affordances: these measures are ours
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.mesh import MeshParts, ObjectMesh, ObjectSpec, ObjectViews
from schemas.negative import NegativeAffordances, NegativeScores, PartCandidates, PartDescriptions, PartScores

LIBRARIES = ("numpy", "opencv-python-headless")
THREADS = 1
MEMORY_GIB = 0.5


@dataclass(frozen=True)
class Params:
    threshold: float = 0.5
    """probability above which a face is negative"""
    seed: int = 0
    """seed of the random candidate and of the points that are counted"""


def run(spec: ObjectSpec, mesh: ObjectMesh, parts: MeshParts, views: ObjectViews, candidates: PartCandidates,
        descriptions: PartDescriptions, scores: PartScores, found: NegativeAffordances,
        params: Params) -> NegativeScores:  # fmt: skip
    """Score one object."""
    from afford.backends.describe.lexicon import truth
    from afford.encode import jpeg
    from afford.negative.score import score
    from afford.negative.sheet import QUALITY, row

    true = {one.task: truth(mesh.category, one.task) for one in descriptions.descriptions}
    rows = score(mesh, parts, views, candidates, descriptions, scores, found, true, params.threshold, params.seed)
    six, every = float(views.seen_area[5]), float(views.seen_area[-1])
    title = f"{mesh.category.replace('_', ' ')}, {found.tasks[0].task}", f"{spec.split}, {spec.look}", f"IoU {rows[0].iou:.2f}"
    picture = jpeg(row(views, found, title), QUALITY)
    return NegativeScores(mesh.name, mesh.category, spec.split, spec.look, six, every, rows, picture)
