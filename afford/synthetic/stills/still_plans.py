"""An act and what the hands can reach -> every natural way to do it: which hand or hands, on which part."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import product

import numpy as np

from afford.synthetic.kitchens.scene_builder import BOTH_APART_M
from afford.synthetic.stills.still_tasks import Act
from afford.synthetic.stills.still_ways import Reach, Way
from schemas.video import SIDES

SLACK = 0.12
"""Left or right is a matter of taste when their comfort differs by less."""
PART_SLACK = 0.35
"""Another part of the thing is still natural when it costs no more comfort than this."""
CROSSED = 3.0
"""Comfort lost per metre by which the left palm is to the right of the right one."""
TASTE = 0.15
"""Comfort that makes a way e times as likely."""
EITHER = ("bowl", "pan")
"""Wide kinds that people carry with one hand or with two, as they like."""
MOST = 6


@dataclass(frozen=True)
class Plan:
    """What each hand does; None for an idle hand."""

    left: Way | None
    right: Way | None
    comfort: float

    @property
    def ways(self) -> tuple[Way | None, Way | None]:
        """(left, right)."""
        return self.left, self.right

    @property
    def taxonomy(self) -> int:
        """Taxonomy, 4-way: 0 left, 1 right, 2 both on one thing, 3 both on different things."""
        if self.left and self.right:
            return 2 if self.left.thing is self.right.thing else 3
        return 0 if self.left else 1

    @property
    def parts(self) -> tuple[str, ...]:
        """What is taken, whichever hand takes it."""
        return tuple(sorted(f"{way.thing.number} {way.grip.name} {way.grip.kind}" for way in self.ways if way))


def plans(act: Act, reach: Reach) -> list[Plan]:
    """The natural plans, most comfortable first; none when the act cannot be done."""
    one = _natural(_one_hand(act, reach))
    if act.support is None:
        return one[:MOST]
    two = _natural(_two_hands(act, reach))
    either = not act.must and len(act.things) == 1 and act.kinds[0] in EITHER
    chosen = [*two, *one] if either else two if two or act.must else one
    return sorted(chosen, key=lambda plan: -plan.comfort)[:MOST]


def weights(chosen: Iterable[Plan]) -> np.ndarray:
    """(n,) how likely a person takes each plan; they sum to 1."""
    comfort = np.array([plan.comfort for plan in chosen])
    likely = np.exp((comfort - comfort.max()) / TASTE)
    return likely / likely.sum()


def _one_hand(act: Act, reach: Reach) -> list[Plan]:
    parts = act.parts if act.alone is None else act.alone
    return [Plan(way if side == "left" else None, way if side == "right" else None, way.comfort)
            for side in SIDES for way in reach.ways(act.things[0], side, parts)]


def _two_hands(act: Act, reach: Reach) -> list[Plan]:
    found: dict[tuple[str, ...], Plan] = {}
    for lead, other in (SIDES, SIDES[::-1]):
        firsts, seconds = reach.ways(act.things[0], lead, act.parts), reach.ways(act.things[-1], other, act.support or ())
        for first, second in product(firsts, seconds):
            left, right = (first, second) if lead == "left" else (second, first)
            plan = _together(left, right)
            if plan:
                found[f"{left.thing.number} {left.grip.name}", f"{right.thing.number} {right.grip.name}"] = plan
    return list(found.values())


def _together(left: Way, right: Way) -> Plan | None:
    """Both hands at once, unless they would run into each other; crossed arms are less comfortable."""
    a, b = left.palm[:3, 3], right.palm[:3, 3]
    if np.linalg.norm(a - b) < BOTH_APART_M:
        return None
    return Plan(left, right, min(left.comfort, right.comfort) - CROSSED * max(0.0, float(a[0] - b[0])))


def _natural(candidates: list[Plan]) -> list[Plan]:
    """Those that a person might choose: near the best of their kind, and of a kind near the best of all."""
    best: dict[tuple[str, ...], float] = {}
    for plan in candidates:
        best[plan.parts] = max(best.get(plan.parts, -np.inf), plan.comfort)
    limit = max(best.values(), default=0.0) - PART_SLACK
    fit = [plan for plan in candidates if plan.comfort >= max(limit, best[plan.parts] - SLACK)]
    return sorted(fit, key=lambda plan: -plan.comfort)
