"""comparisons on all objects -> a table with confidence intervals, and the same as JSON.

Reads   GraspComparison of each object
Writes  grasp_compare.md and grasp_compare.json: shares of trials with Wilson intervals; differences of success between methods,
        paired by object, with intervals by resampling objects
Method  counts; trials on one object are not independent, which only the second interval accounts for
Fails   without a comparison, or when objects were compared with different methods or engines
Paper   2HandedAfforder, robot experiment
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.grasp import GraspComparison
from schemas.spec import Context

LIBRARIES = ("numpy", "scipy", "blake3")
THREADS = 1
MEMORY_GIB = 0.3


@dataclass(frozen=True)
class Params:
    """Parameters of grasp_compare_report."""

    seed: int = 0
    """seed of the resampling"""


def run(comparisons: tuple[GraspComparison, ...], params: Params, ctx: Context) -> FileTree:
    """Write table and JSON."""
    from dataclasses import asdict

    from afford.common.files import empty_folder, tree, write_json
    from afford.grasping.candidates.comparison_report import differences, shares, table

    kinds = {(one.methods, one.engines) for one in comparisons}
    if len(kinds) != 1:
        raise ValueError(f"grasp_compare_report: expected comparisons of one set of methods and engines, got {len(kinds)}; compare "
                         "all objects with the same parameters")  # fmt: skip
    out = empty_folder(ctx.scratch / "out")
    (out / "grasp_compare.md").write_text(table(comparisons, params.seed), encoding="utf-8", newline="\n")
    rows = {"shares": [asdict(row) for row in shares(comparisons)],
            "differences": [asdict(row) for row in differences(comparisons, params.seed)]}  # fmt: skip
    write_json(out / "grasp_compare.json", {"objects": [one.name for one in comparisons], **rows})
    return tree("grasp_compare", out)
