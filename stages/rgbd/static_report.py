"""what static_evaluate said of several models on the same pictures -> one table, the paper's figures below.

Reads   FileTrees of static_evaluate: metrics.json
Writes  FileTree: metrics.json (<method>.iou, .f, .fw, .closed.iou), report.md
Method  side by side, in the order in which they come
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
    name: str = "static"
    """what the set is called in the report"""


def run(reports: tuple[FileTree, ...], params: Params, ctx: Context) -> FileTree:
    """One table of all."""
    from afford.common.files import empty_folder, tree
    from afford.rgbd.evaluate.static_table import read_figures, write

    found = {report.name: read_figures(report) for report in reports}
    return tree(params.name, write(empty_folder(ctx.scratch / "table"), params.name, found))
