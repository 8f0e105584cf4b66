"""motions in a robot hand's joints, and what was dropped -> files for people and for other programs.

Reads   ReferenceSet
Writes  FileTree: references/<clip>.npz (plain arrays, docs/grasping/motion.md), verdicts.csv (every clip), metrics.json, report.md
Method  as they are; nothing is rounded but in the report
Fails   ValueError when there is no reference
Paper   AffordDex, HTI: what a policy imitates
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
    name: str = "motions"
    """what the set is called in the report"""


def run(references: ReferenceSet, params: Params, ctx: Context) -> FileTree:
    """One folder of all."""
    from afford.common.files import empty_folder, tree
    from afford.grasping.motion.reference_files import write_references

    if not references.references:
        raise ValueError(f"{params.name}: no motion of {len(references.report.verdicts)} can be imitated; see the reasons in their "
                         "verdicts")  # fmt: skip
    return tree(params.name, write_references(empty_folder(ctx.scratch / "motions"), params.name, references))
