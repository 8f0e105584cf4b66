"""afford: two-hand affordances and grasps from video. `python pipeline.py --help` lists the verbs.

A target is a graph, whose lines are in `maps/`. Every line adds one stage: a pure function of typed inputs and `Params`, cached
under the digest of its code, its parameters and the content of its inputs.
"""

from __future__ import annotations

import sys
from importlib.util import find_spec
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from maps.settings import Origin, Settings
    from runner import Graph

TARGETS = {"dataset": "maps.extraction:dataset",
           "train": "maps.twohands:train",
           "benchmark": "maps.twohands:measure",
           "ablation": "maps.twohands:ablate",
           "hands": "maps.extraction:hands", "held": "maps.extraction:held",
           "negative-affordance": "maps.surface:negative_affordance",
           "motions": "maps.motions:motions",
           "grasp": "maps.own_meshes:grasp",
           "grasp-full": "maps.grasping:grasp_full",
           "grasp-play": "maps.grasping:grasp_play",
           "grasp-adapt": "maps.own_meshes:grasp_adapt",
           "grasp-household": "maps.household:grasp_household",
           "grasp-prior": "maps.motions:grasp_prior",
           "interactions": "maps.rgbd:interactions",
           "sor3d": "maps.rgbd:sor3d",
           "sor3d-ablation": "maps.rgbd:sor3d_ablation",
           "static-sets": "maps.rgbd:static_sets",
           "extraction-report": "maps.extraction:extraction_quality",
           "recordings": "maps.extraction:recordings",
           "scenes": "maps.synthetic:scenes",
           "train-set": "maps.synthetic:train_set",
           "benchmark-set": "maps.synthetic:benchmark_stills",
           "all": "maps.everything:everything"}  # fmt: skip
"""target -> function that builds its graph, in the order of the help; its module is imported when the graph is built"""


PACKAGES = ("commands", "maps", "runner", "schemas", "stages")
"""top-level packages of the project besides afford; a user's module of the same name would hide one"""


def build(target: str, origin: Origin, p: Settings) -> Graph:
    """Build the graph of one target of `TARGETS`."""
    from afford.common.registry import load
    from runner import Graph

    g = Graph()
    load(TARGETS, target)(g, origin, p)
    return g


def main(arguments: list[str] | None = None) -> int:
    """Run `python pipeline.py`, or the console script `afford`; return the exit code.

    SystemExit where the command cannot start.
    """
    if find_spec("typer") is None:
        raise SystemExit(f"error: afford's libraries are not installed for {sys.executable}; run `make setup`, then use "
                         "`. .venv/bin/activate` or .venv/bin/python")  # fmt: skip
    try:
        from afford.shadows import refuse

        refuse(PACKAGES)
    except ImportError as error:
        raise SystemExit(f"error: {error}") from None
    from commands.cli import main as command

    return command(TARGETS, build, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
