"""Measure grasps from masks: what the best candidates hold, from affordance masks and from whole objects, in both engines.

    PYTHONPATH=. python benchmarks/bench_candidates.py [--model DIR] [--objects N] [--looks N]

Writes the table of docs/grasping/grasp-candidates.md. `--model` is a folder that `make train` published; without it the rows of the
two-hand model are left out.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from afford.common.files import tree
from afford.grasping.candidates.comparison_report import table
from afford.grasping.hand.assets import shadow_files
from afford.surface.negative.export import task_slug
from afford.synthetic.splits import object_specs
from benchmarks.pages import ROOT, into
from schemas.files import FileTree
from schemas.grasp import GraspComparison
from schemas.hand import HandModel
from schemas.mesh import ObjectSpec
from stages.grasping import grasp_compare, hand_model, object_solids
from stages.surface import part_describe, view_render
from stages.synthetic import object_build

CATEGORIES = ("hammer", "knife", "screwdriver", "spatula", "chisel", "ladle", "saw", "brush", "trowel", "cleaver", "axe", "razor")
"""categories that rest stably and have a handle and a forbidden part; the last three are categories that training never shows"""
SEED = 20267
PAGE = ROOT / "docs" / "grasping" / "grasp-candidates.md"


@dataclass(frozen=True)
class Here:
    """Context of a stage that is called directly."""

    scratch: Path

    def progress(self, done: int, total: int) -> None:
        """Ignore progress."""


def main() -> None:
    """Compare, and write."""
    asked = argparse.ArgumentParser()
    asked.add_argument("--model", type=Path)
    asked.add_argument("--objects", type=int, default=2)
    asked.add_argument("--looks", type=int, default=2)
    options = asked.parse_args()
    model = tree("model", options.model) if options.model else FileTree("none", ())
    hand, found, began = hand_model.run(shadow_files(), hand_model.Params()), [], time.process_time()
    for spec in object_specs("seen", CATEGORIES, options.objects, SEED, 0):
        try:
            found.append(compared(hand, spec, model, options.looks))
        except ValueError as error:
            print(f"left out: {error}", file=sys.stderr)
            continue
        print(spec.name, found[-1].figure("success").mean((1, 2, 3)).round(2).tolist(), flush=True)
    trials = sum(one.values[0, 0, ..., 0].size for one in found)
    seconds = (time.process_time() - began) / max(trials, 1)
    about = f"{len(found)} objects of {len(CATEGORIES)} categories, {trials} looks; {seconds:.1f} CPU seconds a look."
    into(PAGE, "comparison", "bench_candidates.py", f"{table(found, SEED)}\n{about}\n")


def compared(hand: HandModel, spec: ObjectSpec, model: FileTree, looks: int) -> GraspComparison:
    """Compare methods on one object."""
    built = object_build.run(spec, object_build.Params(max_faces=8000, atlas_px=256))
    body = object_solids.run(built.mesh, built.parts, object_solids.Params(points=256))
    views = view_render.run(built.mesh, view_render.Params(size_px=32, directions=16, share=0.0))
    told = part_describe.run(built.mesh, views, part_describe.Params())
    with tempfile.TemporaryDirectory(prefix=task_slug(spec.name)) as scratch:
        params = grasp_compare.Params(looks=looks)
        return grasp_compare.run(hand, built.mesh, built.parts, body, told, model, params, Here(Path(scratch)))


if __name__ == "__main__":
    main()
