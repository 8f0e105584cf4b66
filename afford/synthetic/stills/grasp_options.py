"""The ways in which one hand can take a thing as it lies there: which side, which part, how turned, and how comfortably."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from afford.render.motion import Pose, about, pose
from afford.synthetic.assets.object_model import Grip, ObjectModel, edge, mirror_grip
from afford.synthetic.human_hand.skeleton import ROOTS, WRIST
from afford.synthetic.kitchens.scene_builder import BOTH_APART_M, comfort
from afford.synthetic.kitchens.world import elbow
from afford.synthetic.stills.table_layout import Placed, height_at, height_map
from afford.synthetic.stills.task_catalogue import Task
from schemas.video import SIDES

ROUND = ("mug", "bottle", "water", "jar", "can", "bowl", "plate", "glue", "paint", "tape", "cup", "glass", "grinder")
"""Kinds whose body, rim, neck, head or lid can be taken from all around."""
SQUARE = ("carton",)
"""Kinds that can be taken from four sides."""
FIXED_PARTS = ("handle",)
PAN_RIM = "pan rim"
TURNS = {"round": 36, "square": 4}
CROSSING = 4.0
"""Comfort lost per metre that a palm reaches beyond the middle of the body to the other hand's side."""
BEYOND = 5.0
"""Comfort lost per metre that a palm reaches past the middle of a thing to its far side."""
LEAST = 0.45
"""A hand goes nowhere less comfortable than this."""
CLEAR_M = 0.022
"""Room between a palm and a handle that it does not take."""
ARM_M = np.array([0.06, 0.12, 0.18, 0.24])
HAND_RADIUS_M, ARM_RADIUS_M = 0.016, 0.034
MIRROR = np.diag([1.0, -1.0, 1.0])


@dataclass(frozen=True, eq=False)
class GripOption:
    """A hand on a thing; `turn` (0 of 1, or k of n) is how the grip is turned about the thing's own axis."""

    thing: Placed
    grip: Grip
    turn: int
    comfort: float

    @property
    def side(self) -> str:
        """left or right."""
        return self.grip.side

    @property
    def palm(self) -> Pose:
        """T_world_palm."""
        return self.thing.T_world_obj @ self.grip.T_obj_palm


def with_more_grips(model: ObjectModel) -> ObjectModel:
    """A pan can also be held by the sides of its rim; a mug's handle is taken from outside with the left hand too."""
    if model.kind == "pan" and model.opening is not None:
        return replace(model, grips=(*model.grips, *edge(PAN_RIM, (float(model.size[0]) / 2, 0.0, model.opening[2]), 0.01)))
    if model.kind == "mug":
        right = next(grip for grip in model.grips_of("right") if grip.name == "handle")
        other = mirror_grip(right)
        left = replace(other, T_obj_palm=pose((0, 0, 0), about((0, 0, 1), np.pi)) @ other.T_obj_palm)
        rest = (grip for grip in model.grips if grip.name != "handle")
        return replace(model, grips=(*rest, right, left))
    return model


class ReachModel:
    """What the hands of a person can take in one layout."""

    def __init__(self, things: Sequence[Placed]) -> None:
        self.things = list(things)
        self._built = {thing.number: height_map([other for other in things if other is not thing]) for thing in things}

    def ways(self, thing: Placed, side: str, names: Sequence[str] = ()) -> list[GripOption]:
        """The best way for each part and kind of grip of this hand that is comfortable and free, best first. `names` are the
        parts that count, all when empty.
        """
        best: dict[tuple[str, str], GripOption] = {}
        for way in self._all(thing, side, names):
            key = (way.grip.name, way.grip.kind)
            if way.comfort > LEAST and (key not in best or way.comfort > best[key].comfort) and self._free(way):
                best[key] = way
        return sorted(best.values(), key=lambda way: -way.comfort)

    def _all(self, thing: Placed, side: str, names: Sequence[str]) -> Iterator[GripOption]:
        for grip in thing.model.grips_of(side):
            if not names or grip.name in names:
                for turn, turned in enumerate(_turned(thing.model, grip)):
                    yield GripOption(thing, turned, turn, _comfort(thing.T_world_obj @ turned.T_obj_palm, thing, side))

    def _free(self, way: GripOption) -> bool:
        """Whether palm, knuckles and forearm stay clear of other things and of the thing's own handle."""
        points, radius = _arm(way)
        stands = height_at(self._built[way.thing.number], points)
        if ((stands > 0) & (points[:, 2] - radius < stands)).any():
            return False
        return _clear_of_handle(way, points[: len(ROOTS) + 1])


def _comfort(palm: Pose, thing: Placed, side: str) -> float:
    """How naturally an arm reaches a palm pose (about -2..1): also not to the other hand's side, and not behind the thing."""
    across = float(-palm[0, 3] if side == "right" else palm[0, 3])
    beyond = float(palm[1, 3] - thing.T_world_obj[1, 3])
    return comfort(palm, side) - CROSSING * max(0.0, across) - BEYOND * max(0.0, beyond)


def _turned(model: ObjectModel, grip: Grip) -> Iterator[Grip]:
    shape = "round" if model.kind in ROUND or grip.name == PAN_RIM else "square" if model.kind in SQUARE else ""
    if not shape or grip.name in FIXED_PARTS:
        yield grip
        return
    for angle in np.arange(TURNS[shape]) * (2 * np.pi / TURNS[shape]):
        yield replace(grip, T_obj_palm=pose((0, 0, 0), about((0, 0, 1), angle)) @ grip.T_obj_palm)


def _arm(way: GripOption) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) world points in the palm, at the knuckles, the wrist and along the forearm, and the thickness there, metres."""
    palm = way.palm
    local = np.concatenate([np.zeros((1, 3)), ROOTS, WRIST[None]]) @ (MIRROR if way.side == "left" else np.eye(3))
    hand = local @ palm[:3, :3].T + palm[:3, 3]
    back = elbow(way.side, palm) - hand[-1]
    arm = hand[-1] + ARM_M[:, None] * back / np.linalg.norm(back)
    return np.concatenate([hand, arm]), np.repeat([HAND_RADIUS_M, ARM_RADIUS_M], [len(hand), len(arm)])


def _clear_of_handle(way: GripOption, points: np.ndarray) -> bool:
    if way.grip.name in FIXED_PARTS:
        return True
    handles = [part.mesh.vertices for part in way.thing.model.parts if part.name in FIXED_PARTS]
    if not handles:
        return True
    T = way.thing.T_world_obj
    world = np.concatenate(handles)[::4] @ T[:3, :3].T + T[:3, 3]
    return float(np.linalg.norm(world[None] - points[:, None], axis=2).min()) > CLEAR_M


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
class GraspPlan:
    """What each hand does; None for an idle hand."""

    left: GripOption | None
    right: GripOption | None
    comfort: float

    @property
    def ways(self) -> tuple[GripOption | None, GripOption | None]:
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


def grasp_plans(act: Task, reach: ReachModel) -> list[GraspPlan]:
    """The natural plans, most comfortable first; none when the act cannot be done."""
    one = _natural(_one_hand(act, reach))
    if act.support is None:
        return one[:MOST]
    two = _natural(_two_hands(act, reach))
    either = not act.must and len(act.things) == 1 and act.kinds[0] in EITHER
    chosen = [*two, *one] if either else two if two or act.must else one
    return sorted(chosen, key=lambda plan: -plan.comfort)[:MOST]


def plan_weights(chosen: Iterable[GraspPlan]) -> np.ndarray:
    """(n,) how likely a person takes each plan; they sum to 1."""
    comfort = np.array([plan.comfort for plan in chosen])
    likely = np.exp((comfort - comfort.max()) / TASTE)
    return likely / likely.sum()


def _one_hand(act: Task, reach: ReachModel) -> list[GraspPlan]:
    parts = act.parts if act.alone is None else act.alone
    return [GraspPlan(way if side == "left" else None, way if side == "right" else None, way.comfort)
            for side in SIDES for way in reach.ways(act.things[0], side, parts)]


def _two_hands(act: Task, reach: ReachModel) -> list[GraspPlan]:
    found: dict[tuple[str, ...], GraspPlan] = {}
    for lead, other in (SIDES, SIDES[::-1]):
        firsts, seconds = reach.ways(act.things[0], lead, act.parts), reach.ways(act.things[-1], other, act.support or ())
        for first, second in product(firsts, seconds):
            left, right = (first, second) if lead == "left" else (second, first)
            plan = _together(left, right)
            if plan:
                found[f"{left.thing.number} {left.grip.name}", f"{right.thing.number} {right.grip.name}"] = plan
    return list(found.values())


def _together(left: GripOption, right: GripOption) -> GraspPlan | None:
    """Both hands at once, unless they would run into each other; crossed arms are less comfortable."""
    a, b = left.palm[:3, 3], right.palm[:3, 3]
    if np.linalg.norm(a - b) < BOTH_APART_M:
        return None
    return GraspPlan(left, right, min(left.comfort, right.comfort) - CROSSED * max(0.0, float(a[0] - b[0])))


def _natural(candidates: list[GraspPlan]) -> list[GraspPlan]:
    """Those that a person might choose: near the best of their kind, and of a kind near the best of all."""
    best: dict[tuple[str, ...], float] = {}
    for plan in candidates:
        best[plan.parts] = max(best.get(plan.parts, -np.inf), plan.comfort)
    limit = max(best.values(), default=0.0) - PART_SLACK
    fit = [plan for plan in candidates if plan.comfort >= max(limit, best[plan.parts] - SLACK)]
    return sorted(fit, key=lambda plan: -plan.comfort)
