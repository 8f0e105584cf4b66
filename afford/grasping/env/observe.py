"""What a policy sees: blocks of numbers, by a table. R is the robot, O the object's state, P its points, N the points that must not
be touched. The prior sees R O P, the teacher R O P N, the student R P N (AffordDex).

`small` is for perceptrons; `paper` are the 300 published numbers in their order, N is 300 more; `points` has clouds instead of the
paper's feature of the object.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from afford.grasping.env.moment import Block, Now
from afford.grasping.env.observe_paper import CLOUD_N, CLOUD_OBJECT, FEATURE, OBJECT, ROBOT, UNUSED
from afford.grasping.env.observe_small import SMALL

LAYOUTS: Mapping[str, Mapping[str, tuple[Block, ...]]] = {
    "small": SMALL,
    "paper": {"R": ROBOT, "O": (OBJECT,), "P": (UNUSED, FEATURE), "N": (CLOUD_N,)},
    "points": {"R": ROBOT, "O": (OBJECT,), "P": (CLOUD_OBJECT,), "N": (CLOUD_N,)},
}
STATES: Mapping[str, str] = {"prior": "ROP", "teacher": "ROPN", "student": "RPN"}
LIMIT = 100.0
"""numbers are cut off here, so that a contact of a diverging engine is not a number of any size"""


def blocks(layout: str, role: str) -> tuple[Block, ...]:
    """In order; ValueError for a layout or a role that is not known."""
    if layout not in LAYOUTS or role not in STATES:
        raise ValueError(f"observation: expected a layout of {', '.join(LAYOUTS)} and a role of {', '.join(STATES)}, "
                         f"got {layout!r} and {role!r}")
    return tuple(block for group in STATES[role] for block in LAYOUTS[layout][group])


def slices(chosen: Sequence[Block]) -> dict[str, slice]:
    """Where each block stands."""
    ends = np.cumsum([block.width for block in chosen]).tolist()
    return {block.name: slice(end - block.width, end) for block, end in zip(chosen, ends, strict=True)}


def observe(chosen: Sequence[Block], now: Now) -> np.ndarray:
    """(n, d) float32. ValueError for a block that another hand than the Shadow Hand makes wider or narrower."""
    parts = [block.cut(now).reshape(len(now.phase), -1) for block in chosen]
    wrong = [(block, part) for block, part in zip(chosen, parts, strict=True) if part.shape[1] != block.width]
    if wrong:
        block, part = wrong[0]
        raise ValueError(f"observation, {block.name}: expected {block.width} numbers, as the Shadow Hand gives, "
                         f"got {part.shape[1]}")
    return np.concatenate(parts, axis=1).clip(-LIMIT, LIMIT).astype(np.float32)
