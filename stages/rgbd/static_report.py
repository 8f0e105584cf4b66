"""Tabulate the results of static_evaluate for several models on the same pictures, above the paper's figures.

Reads   FileTrees of static_evaluate: metrics.json
Writes  FileTree: metrics.json (<method>.iou, .f, .fw, .closed.iou), report.md
Method  one line per model, in the given order
Fails   when a report has no figures
Paper   SOR3D-AFF, results on static images; AffordanceNet (Do, Nguyen and Reid 2018) as it reports it
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.spec import Context

LIBRARIES = ("blake3",)
THREADS = 1
MEMORY_GIB = 0.2


@dataclass(frozen=True)
class Params:
    """Parameters of `static_report`."""

    name: str = "static"
    """name of the set in the report"""


def run(reports: tuple[FileTree, ...], params: Params, ctx: Context) -> FileTree:
    """Write one table of all reports."""
    from afford.common.files import empty_folder, tree
    from afford.rgbd.evaluate.static_table import read_figures, write

    found = {report.name: read_figures(report) for report in reports}
    return tree(params.name, write(empty_folder(ctx.scratch / "table"), params.name, found))
