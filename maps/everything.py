"""The targets of `make all`, chained in one graph; a stage that several targets share is one node."""

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
"""target -> function that builds its graph, in order"""


def everything(g: Graph, origin: Origin, p: Settings) -> None:
    """dataset, train, benchmark, negative-affordance, sor3d and grasp in sequence; can be stopped and resumed."""
    for name, lines in CHAIN.items():
        with g.part(name):
            lines(g, origin.of(name), p)
    g.target("all", *(handle for handles in list(g.targets.values()) for handle in handles))
