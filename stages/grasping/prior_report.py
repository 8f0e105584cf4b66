"""clips that a prior learns from, and those that were dropped -> a report of every clip by name, object and reason.

Reads   ReferenceSet of kept clips with the verdicts of all
Writes  FileTree: report.md (clips by source, objects, reasons), clips.csv (every clip), metrics.json
Method  counting
Fails   never
Paper   AffordDex, HTI, does not report which clips it learns from
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.hand import ReferenceSet
from schemas.spec import Context

LIBRARIES = ("numpy", "blake3")
THREADS = 1
MEMORY_GIB = 0.5


@dataclass(frozen=True)
class Params:
    """Parameters of prior_report."""

    name: str = "prior"
    """name of the source in the report"""


def run(references: ReferenceSet, params: Params, ctx: Context) -> FileTree:
    """Write the report."""
    from afford.common.files import empty_folder, tree
    from afford.grasping.motion.reference_files import write_clip_report

    return tree(params.name, write_clip_report(empty_folder(ctx.scratch / "report"), params.name, references))
