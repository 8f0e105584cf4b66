"""Report the scores of many objects: tables, flat metrics, a sheet of images.

Reads   NegativeScores
Writes  metrics.json (<split>.<measure>, <method>.<split>.<measure>, seen_area.six, seen_area.adaptive), report.md, sheet.jpg
Method  means over objects of their means over tasks with a negative part
Fails   when there are no scores
Paper   AffordDex, negative affordance (no figures there)
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.spec import Context
from schemas.surface import NegativeScores

LIBRARIES = ("numpy", "opencv-python-headless", "blake3")
THREADS = 1
MEMORY_GIB = 0.5


@dataclass(frozen=True)
class Params:
    """Parameters of `negative_affordance_report`."""

    per_category: int = 1
    """objects of each category and split in the sheet"""


def run(scores: tuple[NegativeScores, ...], params: Params, ctx: Context) -> FileTree:
    """Report the scores of all objects."""
    from afford.surface.negative import score_report

    return score_report.write_report(scores, params.per_category, ctx.scratch)
