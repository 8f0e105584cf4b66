"""Rules of each object type and affordance: the grips that suit it, and the part that the label marks.

The label of a sequence marks the visible pixels, in the last frame, of the part that the affordance is about:

    grasp, lift   the held part: the handle, or the body (ball: upper half; flat objects: the half that the hand takes)
    push          the half of the object on the side where the hand pushed
    rotate        the turned part: neck and cap of a bottle, upper part of a can or cup, a flat object as a whole
    squeeze       the body
    cut, hammer, paint, type    blade, head, bristles, screen

Push, lift, rotate and grasp show the same instances, people and tables, so only the motion of the hand distinguishes them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

ROUNDING = 1e-3
"""Tolerance of the height limits, as a share of the object's height."""


@dataclass(frozen=True)
class Rule:
    """Affordance of an object type: the allowed grips (empty: any), and the region that the label marks."""

    grips: tuple[str, ...] = ()
    parts: tuple[str, ...] = ()
    """names of the marked parts; empty for all"""
    above: float = 0.0
    """lower limit of the marked region, as a share of the object's height"""
    below: float = 1.0
    """upper limit of the marked region, as a share of the object's height"""
    near: bool = False
    """True to mark only the half on the side of the hand"""

    def marks(self, points: np.ndarray, height_m: float, towards: np.ndarray) -> np.ndarray:
        """Mark points (n, 3) of the named parts, object frame; (n,) bool. `towards` (2,) points from the axis to the hand."""
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
"""share of sequences of each affordance: the class weights of the paper's weighted F measure"""


def affordance_rule(object_type: str, affordance: str) -> Rule:
    """Return the rule of an object type and affordance. Raises ValueError when the object does not afford it."""
    if affordance not in AFFORDANCE_RULES[object_type]:
        known = ", ".join(AFFORDANCE_RULES[object_type])
        raise ValueError(f"InteractionSpec.affordance: expected one of {known} for a {object_type}, got {affordance!r}")
    return AFFORDANCE_RULES[object_type][affordance]


def types_for(affordance: str) -> tuple[str, ...]:
    """Return the object types that afford this."""
    return tuple(kind for kind, uses in AFFORDANCE_RULES.items() if affordance in uses)
