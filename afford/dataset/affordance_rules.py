"""What each type of thing is used for, how the hand takes it then, and which part of it the label marks: one table.

The label of a sequence is the visible pixels, in the last frame, of the part that the affordance is about:

    grasp, lift   the part by which it is held: the handle, or the body (ball: upper half; flat things: the
                  half that the hand takes)
    push          the half of the thing at the side where the hand pushed
    rotate        the part that is turned: neck and cap of a bottle, upper part of a can or cup, a flat thing as a whole
    squeeze       the body
    cut, hammer, paint, type    blade, head, bristles, screen

Push, lift, rotate and grasp of one instance show the same thing, people and tables; what the hand does tells them apart.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

ROUNDING = 1e-3
"""Share of the height by which a point may miss a limit: the top of a thing is its top."""


@dataclass(frozen=True)
class Rule:
    """A use of a thing: names of the grips that do (none: any), and what the label marks."""

    grips: tuple[str, ...] = ()
    parts: tuple[str, ...] = ()
    """names of parts; none: all"""
    above: float = 0.0
    """only what is higher than this share of the thing's height"""
    below: float = 1.0
    """only what is lower than this share"""
    near: bool = False
    """only the half at the side of the hand"""

    def marks(self, points: np.ndarray, height_m: float, towards: np.ndarray) -> np.ndarray:
        """(n,) bool of (n, 3) points of the named parts, frame of the thing; `towards` (2,) is where the hand was from its axis."""
        share = points[:, 2] / height_m
        return (share >= self.above - ROUNDING) & (share <= self.below + ROUNDING) & (not self.near or points[:, :2] @ towards > 0)


SIDE = Rule(near=True)
HANDLE = Rule(("handle",), ("handle", "rivets"))
BODY = Rule(("body",), ("body", "glass", "label", "steel"))
CUP = Rule(("body",), ("body", "inside"))
AFFORDANCE_RULES: dict[str, dict[str, Rule]] = {
    "ball": {"grasp": Rule(("top",), above=0.5), "lift": Rule(("top",), above=0.5), "push": SIDE, "squeeze": Rule(("top",))},
    "book": {"grasp": Rule(("edge",), near=True), "lift": Rule(("edge",), near=True), "push": SIDE, "rotate": Rule(("edge",))},
    "bottle": {"grasp": Rule(("body",), below=0.62), "lift": Rule(("body",), below=0.62), "push": SIDE,
               "rotate": Rule(("neck",), above=0.62)},
    "brush": {"grasp": HANDLE, "lift": HANDLE, "paint": Rule(("handle",), ("bristles",))},
    "can": {"grasp": BODY, "lift": BODY, "push": SIDE, "rotate": Rule(("rim",), above=0.55), "squeeze": Rule(("body",))},
    "cup": {"grasp": CUP, "lift": CUP, "push": SIDE, "rotate": Rule(("rim",), ("body", "inside"), above=0.5)},
    "hammer": {"grasp": HANDLE, "lift": HANDLE, "hammer": Rule(("handle",), ("head",))},
    "knife": {"grasp": HANDLE, "lift": HANDLE, "cut": Rule(("handle",), ("blade",))},
    "pitcher": {"grasp": HANDLE, "lift": HANDLE, "push": SIDE},
    "smartphone": {"lift": Rule(("edge",), near=True), "push": SIDE, "rotate": Rule(("edge",)), "type": Rule((), ("screen",))},
    "sponge": {"grasp": Rule(("top",), above=0.7), "lift": Rule(("top",), above=0.7), "push": SIDE, "squeeze": Rule(("top",))},
}  # fmt: skip
SHARES = {"grasp": 0.2, "lift": 0.2, "push": 0.1, "cut": 0.0833, "rotate": 0.0833, "hammer": 0.0833, "squeeze": 0.0833,
          "paint": 0.0833, "type": 0.0833}  # fmt: skip
"""how often each affordance is shown: the weights of the paper's weighted F measure, which are those of its data"""


def affordance_rule(object_type: str, affordance: str) -> Rule:
    """The row of the table; ValueError when the thing is not used so."""
    if affordance not in AFFORDANCE_RULES[object_type]:
        known = ", ".join(AFFORDANCE_RULES[object_type])
        raise ValueError(f"InteractionSpec.affordance: expected one of {known} for a {object_type}, got {affordance!r}")
    return AFFORDANCE_RULES[object_type][affordance]


def types_for(affordance: str) -> tuple[str, ...]:
    """The types of things that afford this."""
    return tuple(kind for kind, uses in AFFORDANCE_RULES.items() if affordance in uses)
