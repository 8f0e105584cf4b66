"""Train, validation and test splits of every synthetic source: which scenes, rooms, objects and interactions are rendered.

Each participant, split and category draws from a random stream of its own. So nothing is shared between splits whatever the
seeds, and more objects of one split leave the others unchanged. See docs/synthetic/stills.md and
docs/surface/negative-affordance.md for what training never shows.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from zlib import crc32

import numpy as np

from afford.dataset.affordance_rules import SHARES, types_for
from schemas.interaction import AFFORDANCES, InteractionSpec
from schemas.mesh import ObjectSpec
from schemas.scene import HandRoom, SceneSpec, StillSpec

STANDARD_CLIPS = (("pour", "kitchen"), ("carry", "kitchen"), ("parallax", "kitchen"), ("stir", "kitchen"),
            ("carry_both", "kitchen"), ("hand_over", "kitchen"), ("carry_two", "kitchen"), ("hammer", "workshop"),
            ("cut", "kitchen"), ("tidy_desk", "desk"), ("screw", "workshop"))
HARD_CLIPS = (("never_free", "kitchen"), ("turn_over", "kitchen"), ("open_hinged", "workshop"), ("dart", "kitchen"),
        ("open_jar", "kitchen"), ("turn_over", "desk"), ("open_hinged", "kitchen"))
DATASET_CLIPS = (("pour", "kitchen", "train"), ("carry", "kitchen", "train"), ("carry_both", "kitchen", "train"),
           ("open_jar", "kitchen", "val"), ("hammer", "workshop", "train"), ("fetch_item", "desk", "val"))


def standard_specs(seed: int, n: int = 8) -> tuple[SceneSpec, ...]:
    """Return clips with strong parallax, occlusion, carrying, pouring and two-handed tasks. Participant P91."""
    return tuple(_scene_spec("P91", number, *STANDARD_CLIPS[number % len(STANDARD_CLIPS)], "train", seed) for number in range(n))


def hard_specs(seed: int, n: int = 6) -> tuple[SceneSpec, ...]:
    """Return clips that violate an assumption of the extraction. Participant P92.

    Objects are never unoccluded, rotate out of plane or are articulated, or hands enter and leave between key frames.
    """
    return tuple(_scene_spec("P92", number, *HARD_CLIPS[number % len(HARD_CLIPS)], "train", seed) for number in range(n))


def dataset_specs(seed: int) -> tuple[SceneSpec, ...]:
    """Return the clips that `make dataset` renders without a source: three settings, two splits. Participants P93 and P94."""
    people = {"train": "P93", "val": "P94"}
    return tuple(_scene_spec(people[split], number, act, setting, split, seed)
                 for number, (act, setting, split) in enumerate(DATASET_CLIPS))


def _scene_spec(person: str, number: int, act: str, setting: str, split: str, seed: int) -> SceneSpec:
    own = int(np.random.SeedSequence([seed, int(person[1:]), number]).generate_state(1)[0])
    return SceneSpec(video_id=f"{person}_{number + 1:02d}", script=act, setting=setting, seed=own, split=split)


KNOWN_KINDS = ("mug", "bottle", "pan", "knife", "bowl", "board", "box", "jar", "plate", "spoon", "carton", "can")
"""Kinds of objects in training kitchens and in those of the benchmark."""
EXTRA_TRAINED_KINDS = ("jug", "ladle", "fork", "whisk", "pot", "glass", "grinder", "brush")
"""Kinds of objects that only training kitchens contain."""
TRAINED_KINDS = (*KNOWN_KINDS, *EXTRA_TRAINED_KINDS)
"""Kinds of objects that training shows."""
NEW_KINDS = ("kettle", "spatula", "water")
"""Kinds of objects that training never shows, not even in the background."""
NEW_PAIRS = (("shake", "jar"), ("pour", "carton"), ("stir", "pan"), ("move", "plate"), ("open", "box"))
"""Held-out pairs of verb and kind: training shows the verb with other kinds, and the kind with other verbs."""
TEST_KINDS = {
    "kitchen": KNOWN_KINDS,
    "workshop": ("hammer", "screwdriver", "drill", "wrench", "saw", "toolbox", "glue", "wood", "paint", "can", "box", "jar",
                 "bottle"),
    "desk": ("stapler", "scissors", "tape", "book", "laptop", "cup", "phone", "mug", "bottle", "box", "can", "plate"),
}  # fmt: skip
BENCHMARK_ROOMS = (("P95", "kitchen", "known", 12), ("P96", "kitchen", "new", 6), ("workshop", "workshop", "any", 4),
             ("desk", "desk", "any", 4))  # fmt: skip
"""(participant, setting, task filter, share of the rooms); ids of kitchens begin with P, as EPIC's do"""
SHIFT_ROOMS = (("P84", "workshop"), ("P85", "desk"))
"""(participant, setting) of the validation"""


def object_kinds(setting: str, asks: str, split: str) -> tuple[str, ...]:
    """Return the kinds of objects of a room. Kitchens of the splits train and val have more kinds than those of test."""
    if setting == "kitchen" and split != "test":
        return TRAINED_KINDS
    return (*TEST_KINDS[setting], *NEW_KINDS) if asks == "new" else TEST_KINDS[setting]


def is_held_out(verb: str, things: tuple[str, ...]) -> bool:
    """Return True for a kind, or a pair of the verb and one of the kinds, that training never shows."""
    return any(kind not in TRAINED_KINDS for kind in things) or any((verb, kind) in NEW_PAIRS for kind in things)


def accepts_task(asks: str, new: bool) -> bool:
    """Return True when a task filter (`known`, `new` or `any`) accepts a task. Raises ValueError for another filter."""
    if asks not in ("known", "new", "any"):
        raise ValueError(f"StillSpec.asks: expected known, new or any, got {asks!r}")
    return asks == "any" or (asks == "new") == new


@dataclass(frozen=True)
class RoomExtent:
    """Number of layouts of one room, of views of each layout and of tasks of each view."""

    layouts: int
    views: int
    tasks: int


def train_specs(seed: int, rooms: int, val_rooms: int, extent: RoomExtent) -> tuple[StillSpec, ...]:
    """Return the kitchens of the training set (P81) and of its validation split (P82)."""
    train = [_still_spec("P81", n, "kitchen", seed, "train", "known", extent) for n in range(rooms)]
    return (*train, *(_still_spec("P82", n, "kitchen", seed, "val", "known", extent) for n in range(val_rooms)))


def shift_specs(seed: int, rooms: int, extent: RoomExtent) -> tuple[StillSpec, ...]:
    """Return `rooms` validation rooms of each setting that training does not show: workshops (P84) and desks (P85)."""
    return tuple(_still_spec(person, n, setting, seed, "val", "any", extent)
                 for person, setting in SHIFT_ROOMS for n in range(rooms))  # fmt: skip


def benchmark_specs(seed: int, rooms: int, extent: RoomExtent) -> tuple[StillSpec, ...]:
    """Return about `rooms` rooms in the proportions of `BENCHMARK_ROOMS`, at least one of each row."""
    total = sum(share for *_, share in BENCHMARK_ROOMS)
    return tuple(_still_spec(person, n, setting, seed, "test", asks, extent)
                 for person, setting, asks, share in BENCHMARK_ROOMS for n in range(max(1, round(rooms * share / total))))


def _still_spec(person: str, number: int, setting: str, seed: int, split: str, asks: str, extent: RoomExtent) -> StillSpec:
    """Build a spec with a seed from the random stream of its participant."""
    own = int(np.random.SeedSequence([seed, number, *person.encode()]).generate_state(1, np.uint64)[0] >> 1)
    return StillSpec(f"{person}_{number + 1:02d}", setting, own, split, asks, extent.layouts, extent.views, extent.tasks)


TRAINED_CATEGORIES = (
    "brush", "candle", "chisel", "drill", "flashlight", "fork", "hammer", "iron", "kettle", "knife", "ladle", "mug",
    "paint_roller", "pan", "pizza_cutter", "pliers", "rolling_pin", "saw", "scissors", "screwdriver", "shovel", "spatula",
    "spray_bottle", "teapot", "toothbrush", "trowel", "wine_glass", "wrench",
)
"""Categories of objects that training shows."""
UNSEEN_CATEGORIES = ("axe", "cleaver", "hair_dryer", "pot", "razor", "soldering_iron")
"""Categories that training never shows. Each has a negative part whose kind training shows on objects of another shape: a
cleaver's blade (easy: knives), a pot's hot body (easy: pans), an axe's edge (harder: set across like a hammer's head), a hair
dryer's hot nozzle (harder: a drill's shape), a soldering iron's hot tip (hard: a screwdriver's shape, an iron's danger), a
razor's blade (hard: a thin strip across a stick).
"""
ALONE_CATEGORIES = tuple(name for name in TRAINED_CATEGORIES if name not in NEW_KINDS)
"""Categories of training stills that show one object alone: kettle and spatula stay unknown to the two-hand model."""


def object_specs(split: str, categories: tuple[str, ...], count: int, seed: int, plain_every: int) -> tuple[ObjectSpec, ...]:
    """Return `count` objects of each category, every `plain_every`-th of a single material (0: none).

    Each split and each category has a random stream of its own, so a new category leaves the other objects unchanged.
    """
    return tuple(
        ObjectSpec(f"{category}_{split}_{index:02d}", category, _object_seed(seed, split, category, index),
                   "plain" if plain_every and index % plain_every == plain_every - 1 else "mixed", split)
        for category in categories for index in range(count)
    )  # fmt: skip


def _object_seed(seed: int, split: str, category: str, index: int) -> int:
    """Return a seed of 31 bits."""
    words = [seed, crc32(split.encode()), crc32(category.encode()), index]
    return int(np.random.SeedSequence(words).generate_state(1)[0] >> 1)


def interaction_specs(split: str, count: int, instances: int, subjects: range, seed: int) -> tuple[InteractionSpec, ...]:
    """Return `count` interactions of a split with `instances` instances of each object type, by these subjects (numbered from 1).
    """
    drawn = np.random.default_rng([seed, zlib.crc32(split.encode())])
    turns = dict.fromkeys(AFFORDANCES, 0)
    out = []
    for number, affordance in enumerate(_affordance_sequence(count)):
        kinds, turn = types_for(affordance), turns[affordance]
        turns[affordance] += 1
        kind = kinds[turn % len(kinds)]
        which = (turn // len(kinds) + kinds.index(kind)) % instances
        person = subjects[int(drawn.integers(len(subjects)))]
        instance = f"{split}-{kind}-{which}"
        name = f"Subject{person}_{affordance}_{number:04d}_{kind}"
        out.append(InteractionSpec(name, split, kind, affordance, instance, zlib.crc32(f"{seed}/{instance}".encode()), person,
                                   int(drawn.integers(1 << 31))))  # fmt: skip
    return tuple(out)


def _affordance_sequence(count: int) -> list[str]:
    """Distribute `count` sequences over the affordances, evenly spread and as close to their shares as integers allow."""
    shares = np.array([SHARES[name] for name in AFFORDANCES]) / sum(SHARES.values())
    shown = np.zeros(len(AFFORDANCES))
    out = []
    for number in range(count):
        most = int(np.argmax(shares * (number + 1) - shown))
        shown[most] += 1
        out.append(AFFORDANCES[most])
    return out


HAND_PARTICIPANT = {"train": "P71", "val": "P72"}
HAND_SETTINGS = ("kitchen", "desk", "kitchen", "workshop")


def hand_rooms(split: str, count: int, seed: int) -> tuple[HandRoom, ...]:
    """Return the rooms of a split with alternating settings."""
    person = HAND_PARTICIPANT[split]
    own = [int(np.random.SeedSequence([seed, n, *person.encode()]).generate_state(1, np.uint64)[0] >> 1) for n in range(count)]
    return tuple(HandRoom(f"{person}_{n + 1:02d}", HAND_SETTINGS[n % len(HAND_SETTINGS)], one, split) for n, one in enumerate(own))
