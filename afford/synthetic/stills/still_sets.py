"""Which things, verbs and rooms belong to training and which only to the benchmark (docs/synthetic/stills.md)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schemas.scene import StillSpec

KNOWN = ("mug", "bottle", "pan", "knife", "bowl", "board", "box", "jar", "plate", "spoon", "carton", "can")
"""Kinds of things that stand in training kitchens, and in those of the benchmark."""
MORE = ("jug", "ladle", "fork", "whisk", "pot", "glass", "grinder", "brush")
"""Kinds that only training kitchens have."""
TRAINED = (*KNOWN, *MORE)
"""Kinds that training shows."""
NEW = ("kettle", "spatula", "water")
"""Kinds that training never shows, not even in the background."""
NEW_PAIRS = (("shake", "jar"), ("pour", "carton"), ("stir", "pan"), ("move", "plate"), ("open", "box"))
"""A verb with a kind: training shows the verb with other things, and the thing with other verbs."""
POOLS = {
    "kitchen": KNOWN,
    "workshop": ("hammer", "screwdriver", "drill", "wrench", "saw", "toolbox", "glue", "wood", "paint", "can", "box", "jar",
                 "bottle"),
    "desk": ("stapler", "scissors", "tape", "book", "laptop", "cup", "phone", "mug", "bottle", "box", "can", "plate"),
}  # fmt: skip
BENCHMARK = (("P95", "kitchen", "known", 12), ("P96", "kitchen", "new", 6), ("workshop", "workshop", "any", 4),
             ("desk", "desk", "any", 4))  # fmt: skip
"""(participant, setting, what is asked, share of the rooms): kitchens have ids that begin with P, as EPIC's have."""


def kinds(setting: str, asks: str, split: str) -> tuple[str, ...]:
    """Kinds of things that may stand in such a room; kitchens of the splits train and val have more than those of test."""
    if setting == "kitchen" and split != "test":
        return TRAINED
    return (*POOLS[setting], *NEW) if asks == "new" else POOLS[setting]


def is_new(verb: str, things: tuple[str, ...]) -> bool:
    """Whether training never shows one of these kinds, or never this verb with the first of them (where a tool is used, with
    what it is used on).
    """
    return any(kind not in TRAINED for kind in things) or any((verb, kind) in NEW_PAIRS for kind in things)


def is_asked(asks: str, new: bool) -> bool:
    """Whether a set that asks for `known`, `new` or `any` takes such a task. ValueError for another word."""
    if asks not in ("known", "new", "any"):
        raise ValueError(f"StillSpec.asks: expected known, new or any, got {asks!r}")
    return asks == "any" or (asks == "new") == new


@dataclass(frozen=True)
class Extent:
    """How much is made of one room."""

    layouts: int
    views: int
    tasks: int


def train_specs(seed: int, rooms: int, val_rooms: int, extent: Extent) -> tuple[StillSpec, ...]:
    """Kitchens of the training set (P81) and of its validation split (P82)."""
    train = [_spec("P81", n, "kitchen", seed, "train", "known", extent) for n in range(rooms)]
    return (*train, *(_spec("P82", n, "kitchen", seed, "val", "known", extent) for n in range(val_rooms)))


def benchmark_specs(seed: int, rooms: int, extent: Extent) -> tuple[StillSpec, ...]:
    """About `rooms` rooms in the proportions of `BENCHMARK`, at least one of each row."""
    total = sum(share for *_, share in BENCHMARK)
    return tuple(_spec(person, n, setting, seed, "test", asks, extent)
                 for person, setting, asks, share in BENCHMARK for n in range(max(1, round(rooms * share / total))))


def _spec(person: str, number: int, setting: str, seed: int, split: str, asks: str, extent: Extent) -> StillSpec:
    """Every participant draws from a stream of its own, so that no room or thing is in two sets, whatever the seeds."""
    own = int(np.random.SeedSequence([seed, number, *person.encode()]).generate_state(1, np.uint64)[0] >> 1)
    return StillSpec(f"{person}_{number + 1:02d}", setting, own, split, asks, extent.layouts, extent.views, extent.tasks)
