"""Which sequences to render: affordances by their shares, things and instances by turns, people and instances of one split only."""

from __future__ import annotations

import zlib

import numpy as np

from afford.dataset.sor3d.rules import SHARES, types_for
from schemas.interaction import AFFORDANCES, InteractionSpec


def specs(split: str, count: int, instances: int, subjects: range, seed: int) -> tuple[InteractionSpec, ...]:
    """`count` sequences of a split, with so many instances of each type of thing, by these people (numbers from 1)."""
    drawn = np.random.default_rng([seed, zlib.crc32(split.encode())])
    turns = dict.fromkeys(AFFORDANCES, 0)
    out = []
    for number, affordance in enumerate(_affordances(count)):
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


def _affordances(count: int) -> list[str]:
    """Affordances for `count` sequences, as near to their shares as whole numbers can be, spread evenly."""
    shares = np.array([SHARES[name] for name in AFFORDANCES]) / sum(SHARES.values())
    shown = np.zeros(len(AFFORDANCES))
    out = []
    for number in range(count):
        most = int(np.argmax(shares * (number + 1) - shown))
        shown[most] += 1
        out.append(AFFORDANCES[most])
    return out
