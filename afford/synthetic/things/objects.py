"""The asset library: every object by its kind. The same generator state gives the same object."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from afford.synthetic.things import objects_cooking, objects_desk, objects_kitchen, objects_package, objects_table, objects_workshop
from afford.synthetic.things.asset import ObjectModel

BUILDERS: dict[str, Callable[[np.random.Generator], ObjectModel]] = {
    **objects_table.BUILDERS,
    **objects_cooking.BUILDERS,
    **objects_kitchen.BUILDERS,
    **objects_package.BUILDERS,
    **objects_workshop.BUILDERS,
    **objects_desk.BUILDERS,
}
KITCHEN = (
    "mug",
    "bottle",
    "kettle",
    "pan",
    "knife",
    "bowl",
    "board",
    "box",
    "jar",
    "plate",
    "spoon",
    "spatula",
    "carton",
    "can",
)
WORKSHOP = ("hammer", "screwdriver", "drill", "wrench", "saw", "toolbox", "glue", "wood", "paint")
DESK = ("stapler", "scissors", "tape", "book", "laptop", "cup", "phone", "water")


def build(kind: str, rng: np.random.Generator) -> ObjectModel:
    """A new object of this kind with its own shape, colours and print; KeyError lists the kinds."""
    if kind not in BUILDERS:
        raise KeyError(f"unknown object kind {kind!r}; choose one of {', '.join(sorted(BUILDERS))}")
    return BUILDERS[kind](rng)
