"""motions in the joints of a robot hand, and dropped clips -> files for people and for other programs.

Reads   ReferenceSet
Writes  FileTree: references/<clip>.npz (plain arrays, docs/grasping/motion.md), verdicts.csv (every clip), metrics.json, report.md
Method  values are not changed; only the report is rounded
Fails   ValueError without a reference
Paper   AffordDex, HTI: the motions to imitate
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.hand import ReferenceSet
from schemas.spec import Context

LIBRARIES = ("numpy", "blake3")
THREADS = 1
MEMORY_GIB = 1.0


@dataclass(frozen=True)
class Params:
    """Parameters of motion_files."""

    name: str = "motions"
    """name of the set in the report"""


def run(references: ReferenceSet, params: Params, ctx: Context) -> FileTree:
    """Write all motions into one folder."""
    from afford.common.files import empty_folder, tree
    from afford.grasping.motion.reference_files import write_references

    if not references.references:
        raise ValueError(f"{params.name}: no motion of {len(references.report.verdicts)} can be imitated; see the reasons in their "
                         "verdicts")  # fmt: skip
    return tree(params.name, write_references(empty_folder(ctx.scratch / "motions"), params.name, references))
