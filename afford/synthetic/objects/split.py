"""Which categories training sees and which it never sees, and the specs of every split (docs/surface/negative-affordance.md)."""

from __future__ import annotations

from zlib import crc32

import numpy as np

from schemas.mesh import ObjectSpec

TRAINED = ("brush", "candle", "chisel", "drill", "flashlight", "fork", "hammer", "iron", "kettle", "knife", "ladle", "mug",
           "paint_roller", "pan", "pizza_cutter", "pliers", "rolling_pin", "saw", "scissors", "screwdriver", "shovel", "spatula",
           "spray_bottle", "teapot", "toothbrush", "trowel", "wine_glass", "wrench")  # fmt: skip
"""Categories that training shows."""
UNSEEN = ("axe", "cleaver", "hair_dryer", "pot", "razor", "soldering_iron")
"""Categories that training never shows. Each has a negative part whose kind training knows on things of another shape: a
cleaver's blade (easy: knives), a pot's hot body (easy: pans), an axe's edge (harder: set across like a hammer's head), a hair
dryer's hot nozzle (harder: a drill's shape), a soldering iron's hot tip (hard: a screwdriver's shape, an iron's danger), a
razor's blade (hard: a thin strip across a stick)."""


def specs(split: str, categories: tuple[str, ...], count: int, seed: int, plain_every: int) -> tuple[ObjectSpec, ...]:
    """`count` objects of each category, every `plain_every`-th of one material (0: none). A split has random streams of its own,
    and so has a category, so that a new category changes no other object.
    """
    return tuple(
        ObjectSpec(f"{category}_{split}_{index:02d}", category, _draw(seed, split, category, index),
                   "plain" if plain_every and index % plain_every == plain_every - 1 else "mixed", split)
        for category in categories for index in range(count)
    )  # fmt: skip


def _draw(seed: int, split: str, category: str, index: int) -> int:
    """A seed of 31 bits."""
    words = [seed, crc32(split.encode()), crc32(category.encode()), index]
    return int(np.random.SeedSequence(words).generate_state(1)[0] >> 1)
