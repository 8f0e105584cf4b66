"""scores of all methods -> the report: tables, plots, sheets and a flat dict of metrics.

Reads   MethodScores of every method, all on the same cases
Writes  metrics.json, report.md, tables.tex, cases.json, plots/, sheets/
Method  means over cases with bootstrap intervals, by scene (kitchens, others), source (EPIC, Ego4D) and set (cropped, masks);
        published scores are listed for comparison
Fails   when two methods share a name, or were scored on different cases
Paper   2HandedAfforder, ActAffordance benchmark
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.benchmark import MethodScores
from schemas.files import FileTree
from schemas.spec import Context

LIBRARIES = ("numpy", "scipy", "opencv-python-headless", "pillow", "matplotlib", "blake3")
THREADS = 1
MEMORY_GIB = 1.0


@dataclass(frozen=True)
class Params:
    """Parameters of the stage."""

    predictions: tuple[str, ...] = ()
    """folders with masks of other methods to score; read when the graph is built (docs/twohands/benchmark.md)"""
    resamples: int = 1000
    """resampled sets of cases behind every interval"""
    seed: int = 0
    """seed of the resampling"""


def run(scores: tuple[MethodScores, ...], others: tuple[MethodScores, ...], params: Params, ctx: Context) -> FileTree:
    """Write one report of `scores` and `others`, in this order."""
    from afford.common.files import empty_folder
    from afford.twohands.benchmark import report

    return report.write(scores + others, empty_folder(ctx.scratch / "report"), params.resamples, params.seed)
