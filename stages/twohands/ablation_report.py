"""scores of every trained row and seed -> the ablation: mean and spread of each row, rows that are not finished marked.

Reads   the Recipes that were planned; MethodScores of those whose training and scoring are done, named as their recipe
Writes  metrics.json (<row>.<measure>, <row>.<measure>.sd), ablation.md, ablation.json (seed by seed)
Method  a measure of one seed is its mean over the cropped cases of kitchens (docs/twohands/benchmark.md); a row is the mean over
        its seeds, with the sample standard deviation
Fails   when nothing was scored, or a score belongs to no recipe
Paper   2HandedAfforder, ablations; K hypotheses against one are ours
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.benchmark import MethodScores
from schemas.files import FileTree
from schemas.spec import Context
from schemas.training import Recipe

LIBRARIES = ("numpy", "blake3")
THREADS = 1
MEMORY_GIB = 0.5


@dataclass(frozen=True)
class Params:
    rows: tuple[str, ...] = ("full", "no_text", "clip", "k1")
    """what is trained: full, no_text, clip, k1, lisa, hotspot, extracted"""
    seeds: int = 3
    """trainings of each row, with the seeds 0, 1, ..."""
    steps: int = 1800
    """steps of each training, fewer than those of model_train so that twelve end within the hour; 0 for as many"""


def run(recipes: tuple[Recipe, ...], scores: tuple[MethodScores, ...], params: Params, ctx: Context,
        others: tuple[MethodScores, ...] = ()) -> FileTree:  # fmt: skip
    """One table of all rows; `others` are rows that learned from other data."""
    from afford.common.files import empty_folder, tree
    from afford.training import ablation

    root = empty_folder(ctx.scratch / "ablation")
    ablation.write_ablation(root, recipes, (*scores, *others))
    return tree("ablation", root)
