"""scores of all trained rows and seeds -> the ablation: mean and standard deviation of each row; unfinished rows are marked.

Reads   the planned Recipes; MethodScores of the finished ones, named after their recipe
Writes  metrics.json (<row>.<measure>, <row>.<measure>.sd), ablation.md with a note on rows that cannot be trained at their
        published size here, ablation.json (seed by seed)
Method  a measure of one seed is its mean over the cropped cases of kitchens (docs/twohands/benchmark.md); a row is the mean over
        its seeds, with the sample standard deviation
Fails   when there are no scores, or a score does not belong to a recipe
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
    """Parameters of the stage."""

    rows: tuple[str, ...] = ("full", "no_text", "clip", "k1", "hotspot", "vlm", "lisa", "extracted")
    """trained rows (docs/twohands/benchmark.md)"""
    seeds: int = 3
    """number of trainings of each row, with the seeds 0, 1, ..."""
    steps: int = 1800
    """steps of each training, fewer than in model_train so that a row takes minutes; 0 for the same number"""


def run(recipes: tuple[Recipe, ...], scores: tuple[MethodScores, ...], params: Params, ctx: Context,
        others: tuple[MethodScores, ...] = ()) -> FileTree:  # fmt: skip
    """Write the table of all rows; `others` are rows that were trained on other data."""
    from afford.common.files import empty_folder, tree
    from afford.training import ablation

    root = empty_folder(ctx.scratch / "ablation")
    ablation.write_ablation(root, recipes, (*scores, *others))
    return tree("ablation", root)
