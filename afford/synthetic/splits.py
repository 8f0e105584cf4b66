"""Sets of clips: what `make dataset` renders, and the standard and hard clips that the quality report measures on."""

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
    """Clips that hold strong parallax, occlusion, carrying, pouring and both-hand tasks. Participant P91."""
    return tuple(_scene_spec("P91", number, *STANDARD_CLIPS[number % len(STANDARD_CLIPS)], "train", seed) for number in range(n))


def hard_specs(seed: int, n: int = 6) -> tuple[SceneSpec, ...]:
    """Clips that break what extraction leans on: never unoccluded, out of plane, articulated, in and out between keys. P92."""
    return tuple(_scene_spec("P92", number, *HARD_CLIPS[number % len(HARD_CLIPS)], "train", seed) for number in range(n))


def dataset_specs(seed: int) -> tuple[SceneSpec, ...]:
    """What `make dataset` renders when no source is given: three settings, two splits. Participants P93 and P94."""
    people = {"train": "P93", "val": "P94"}
    return tuple(_scene_spec(people[split], number, act, setting, split, seed)
                 for number, (act, setting, split) in enumerate(DATASET_CLIPS))


def _scene_spec(person: str, number: int, act: str, setting: str, split: str, seed: int) -> SceneSpec:
    own = int(np.random.SeedSequence([seed, int(person[1:]), number]).generate_state(1)[0])
    return SceneSpec(video_id=f"{person}_{number + 1:02d}", script=act, setting=setting, seed=own, split=split)


KNOWN_KINDS = ("mug", "bottle", "pan", "knife", "bowl", "board", "box", "jar", "plate", "spoon", "carton", "can")
"""Kinds of things that stand in training kitchens, and in those of the benchmark."""
EXTRA_TRAINED_KINDS = ("jug", "ladle", "fork", "whisk", "pot", "glass", "grinder", "brush")
"""Kinds that only training kitchens have."""
TRAINED_KINDS = (*KNOWN_KINDS, *EXTRA_TRAINED_KINDS)
"""Kinds that training shows."""
NEW_KINDS = ("kettle", "spatula", "water")
"""Kinds that training never shows, not even in the background."""
NEW_PAIRS = (("shake", "jar"), ("pour", "carton"), ("stir", "pan"), ("move", "plate"), ("open", "box"))
"""A verb with a kind: training shows the verb with other things, and the thing with other verbs."""
TEST_KINDS = {
    "kitchen": KNOWN_KINDS,
    "workshop": ("hammer", "screwdriver", "drill", "wrench", "saw", "toolbox", "glue", "wood", "paint", "can", "box", "jar",
                 "bottle"),
    "desk": ("stapler", "scissors", "tape", "book", "laptop", "cup", "phone", "mug", "bottle", "box", "can", "plate"),
}  # fmt: skip
BENCHMARK_ROOMS = (("P95", "kitchen", "known", 12), ("P96", "kitchen", "new", 6), ("workshop", "workshop", "any", 4),
             ("desk", "desk", "any", 4))  # fmt: skip
"""(participant, setting, what is asked, share of the rooms): kitchens have ids that begin with P, as EPIC's have."""


def object_kinds(setting: str, asks: str, split: str) -> tuple[str, ...]:
    """Kinds of things that may stand in such a room; kitchens of the splits train and val have more than those of test."""
    if setting == "kitchen" and split != "test":
        return TRAINED_KINDS
    return (*TEST_KINDS[setting], *NEW_KINDS) if asks == "new" else TEST_KINDS[setting]


def is_new(verb: str, things: tuple[str, ...]) -> bool:
    """Whether training never shows one of these kinds, or never this verb with the first of them (where a tool is used, with
    what it is used on).
    """
    return any(kind not in TRAINED_KINDS for kind in things) or any((verb, kind) in NEW_PAIRS for kind in things)


def is_asked(asks: str, new: bool) -> bool:
    """Whether a set that asks for `known`, `new` or `any` takes such a task. ValueError for another word."""
    if asks not in ("known", "new", "any"):
        raise ValueError(f"StillSpec.asks: expected known, new or any, got {asks!r}")
    return asks == "any" or (asks == "new") == new


@dataclass(frozen=True)
class RoomExtent:
    """How much is made of one room."""

    layouts: int
    views: int
    tasks: int


def train_specs(seed: int, rooms: int, val_rooms: int, extent: RoomExtent) -> tuple[StillSpec, ...]:
    """Kitchens of the training set (P81) and of its validation split (P82)."""
    train = [_still_spec("P81", n, "kitchen", seed, "train", "known", extent) for n in range(rooms)]
    return (*train, *(_still_spec("P82", n, "kitchen", seed, "val", "known", extent) for n in range(val_rooms)))


def benchmark_specs(seed: int, rooms: int, extent: RoomExtent) -> tuple[StillSpec, ...]:
    """About `rooms` rooms in the proportions of `BENCHMARK`, at least one of each row."""
    total = sum(share for *_, share in BENCHMARK_ROOMS)
    return tuple(_still_spec(person, n, setting, seed, "test", asks, extent)
                 for person, setting, asks, share in BENCHMARK_ROOMS for n in range(max(1, round(rooms * share / total))))


def _still_spec(person: str, number: int, setting: str, seed: int, split: str, asks: str, extent: RoomExtent) -> StillSpec:
    """Every participant draws from a stream of its own, so that no room or thing is in two sets, whatever the seeds."""
    own = int(np.random.SeedSequence([seed, number, *person.encode()]).generate_state(1, np.uint64)[0] >> 1)
    return StillSpec(f"{person}_{number + 1:02d}", setting, own, split, asks, extent.layouts, extent.views, extent.tasks)


TRAINED_CATEGORIES = (
    "brush", "candle", "chisel", "drill", "flashlight", "fork", "hammer", "iron", "kettle", "knife", "ladle", "mug",
    "paint_roller", "pan", "pizza_cutter", "pliers", "rolling_pin", "saw", "scissors", "screwdriver", "shovel", "spatula",
    "spray_bottle", "teapot", "toothbrush", "trowel", "wine_glass", "wrench",
)
"""Categories that training shows."""
UNSEEN_CATEGORIES = ("axe", "cleaver", "hair_dryer", "pot", "razor", "soldering_iron")
"""Categories that training never shows. Each has a negative part whose kind training knows on things of another shape: a
cleaver's blade (easy: knives), a pot's hot body (easy: pans), an axe's edge (harder: set across like a hammer's head), a hair
dryer's hot nozzle (harder: a drill's shape), a soldering iron's hot tip (hard: a screwdriver's shape, an iron's danger), a
razor's blade (hard: a thin strip across a stick)."""


def object_specs(split: str, categories: tuple[str, ...], count: int, seed: int, plain_every: int) -> tuple[ObjectSpec, ...]:
    """`count` objects of each category, every `plain_every`-th of one material (0: none). A split has random streams of its own,
    and so has a category, so that a new category changes no other object.
    """
    return tuple(
        ObjectSpec(f"{category}_{split}_{index:02d}", category, _object_seed(seed, split, category, index),
                   "plain" if plain_every and index % plain_every == plain_every - 1 else "mixed", split)
        for category in categories for index in range(count)
    )  # fmt: skip


def _object_seed(seed: int, split: str, category: str, index: int) -> int:
    """A seed of 31 bits."""
    words = [seed, crc32(split.encode()), crc32(category.encode()), index]
    return int(np.random.SeedSequence(words).generate_state(1)[0] >> 1)


def interaction_specs(split: str, count: int, instances: int, subjects: range, seed: int) -> tuple[InteractionSpec, ...]:
    """`count` sequences of a split, with so many instances of each type of thing, by these people (numbers from 1)."""
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
    """Affordances for `count` sequences, as near to their shares as whole numbers can be, spread evenly."""
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
    """Rooms of a split, settings by turns; each split draws from a stream of its own."""
    person = HAND_PARTICIPANT[split]
    own = [int(np.random.SeedSequence([seed, n, *person.encode()]).generate_state(1, np.uint64)[0] >> 1) for n in range(count)]
    return tuple(HandRoom(f"{person}_{n + 1:02d}", HAND_SETTINGS[n % len(HAND_SETTINGS)], one, split) for n, one in enumerate(own))
