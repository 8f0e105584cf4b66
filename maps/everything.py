"""Map of `make all`: its targets chained as one graph, in which a shared stage is one node."""

from __future__ import annotations

from maps.extraction import dataset
from maps.grasping import grasp
from maps.rgbd import sor3d
from maps.settings import Origin, Settings
from maps.surface import negative_affordance
from maps.twohands import measure, train
from runner import Graph

CHAIN = {"dataset": dataset, "train": train, "benchmark": measure, "negative-affordance": negative_affordance, "sor3d": sor3d,
         "grasp": grasp}  # fmt: skip
"""target -> function that adds its part of the graph, in execution order"""


def everything(g: Graph, origin: Origin, p: Settings) -> None:
    """Build dataset, train, benchmark, negative-affordance, sor3d and grasp, one after the other; resumable."""
    for name, lines in CHAIN.items():
        with g.part(name):
            lines(g, origin.of(name), p)
    g.target("all", *(handle for handles in list(g.targets.values()) for handle in handles))
