"""Sets of clips: what `make dataset` renders, and the standard and hard clips that the quality report measures on."""

from __future__ import annotations

import numpy as np

from schemas.scene import SceneSpec

STANDARD = (("pour", "kitchen"), ("carry", "kitchen"), ("parallax", "kitchen"), ("stir", "kitchen"),
            ("carry_both", "kitchen"), ("hand_over", "kitchen"), ("carry_two", "kitchen"), ("hammer", "workshop"),
            ("cut", "kitchen"), ("tidy_desk", "desk"), ("screw", "workshop"))
HARD = (("never_free", "kitchen"), ("turn_over", "kitchen"), ("open_hinged", "workshop"), ("dart", "kitchen"),
        ("open_jar", "kitchen"), ("turn_over", "desk"), ("open_hinged", "kitchen"))
DATASET = (("pour", "kitchen", "train"), ("carry", "kitchen", "train"), ("carry_both", "kitchen", "train"),
           ("open_jar", "kitchen", "val"), ("hammer", "workshop", "train"), ("fetch_item", "desk", "val"))


def standard_specs(seed: int, n: int = 8) -> tuple[SceneSpec, ...]:
    """Clips that hold strong parallax, occlusion, carrying, pouring and both-hand tasks. Participant P91."""
    return tuple(_spec("P91", number, *STANDARD[number % len(STANDARD)], "train", seed) for number in range(n))


def hard_specs(seed: int, n: int = 6) -> tuple[SceneSpec, ...]:
    """Clips that break what extraction leans on: never unoccluded, out of plane, articulated, in and out between keys. P92."""
    return tuple(_spec("P92", number, *HARD[number % len(HARD)], "train", seed) for number in range(n))


def dataset_specs(seed: int) -> tuple[SceneSpec, ...]:
    """What `make dataset` renders when no source is given: three settings, two splits. Participants P93 and P94."""
    people = {"train": "P93", "val": "P94"}
    return tuple(_spec(people[split], number, act, setting, split, seed)
                 for number, (act, setting, split) in enumerate(DATASET))


def _spec(person: str, number: int, act: str, setting: str, split: str, seed: int) -> SceneSpec:
    own = int(np.random.SeedSequence([seed, int(person[1:]), number]).generate_state(1)[0])
    return SceneSpec(video_id=f"{person}_{number + 1:02d}", script=act, setting=setting, seed=own, split=split)
