"""afford: from video to where each hand goes on an object, and where not. `python pipeline.py --help` lists the verbs.

A target is a graph; its lines stand in `maps/`. Every line adds one stage: a pure function of typed inputs and `Params`, cached
under the digest of its code, its parameters and the content of its inputs.
"""

from __future__ import annotations

from maps.extraction import dataset, extraction_quality, recordings, scenes
from maps.grasps import grasp, grasp_full
from maps.interactions import interactions
from maps.negatives import negative_affordance
from maps.settings import Origin, Settings
from maps.sor3d import sor3d, sor3d_ablation
from maps.twohands import ablate, benchmark_stills, measure, train, train_set
from runner import Graph

TARGETS = {"dataset": dataset, "recordings": recordings, "scenes": scenes, "extraction-report": extraction_quality,
           "train-set": train_set, "benchmark-set": benchmark_stills, "train": train, "benchmark": measure,
           "ablation": ablate, "negative-affordance": negative_affordance,
           "grasp": grasp, "grasp-full": grasp_full, "interactions": interactions,
           "sor3d": sor3d, "sor3d-ablation": sor3d_ablation}


def build(target: str, origin: Origin, p: Settings) -> Graph:
    """The graph of one target of `TARGETS`."""
    g = Graph()
    TARGETS[target](g, origin, p)
    return g


if __name__ == "__main__":
    from commands.cli import main

    raise SystemExit(main())
