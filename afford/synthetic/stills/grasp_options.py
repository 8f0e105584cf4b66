"""Grasp options of one or two hands for a task: which hand takes which part, in which rotation, and how comfortably.

A `GripOption` is one hand on one part. A `GraspPlan` combines the options of the left and the right hand.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from afford.render.motion import Pose, axis_angle, pose
from afford.synthetic.assets.object_model import Grip, ObjectModel, edge, mirror_grip
from afford.synthetic.human_hand.skeleton import ROOTS, WRIST
from afford.synthetic.kitchens.scene_builder import MIN_HAND_GAP_M, comfort
from afford.synthetic.kitchens.world import elbow
from afford.synthetic.stills.table_layout import PlacedObject, height_at, height_map
from afford.synthetic.stills.task_catalogue import Task
from schemas.video import SIDES

ROUND_KINDS = ("mug", "bottle", "water", "jar", "can", "bowl", "plate", "glue", "paint", "tape", "cup", "glass", "grinder")
"""Kinds whose body, rim, neck, head or lid can be gripped from all around."""
SQUARE_KINDS = ("carton",)
"""Kinds that can be gripped from four sides."""
FIXED_PARTS = ("handle",)
PAN_RIM = "pan rim"
TURNS = {"round": 36, "square": 4}
CROSSING_COST = 4.0
"""Comfort lost per metre that a palm crosses the middle of the body to the other hand's side."""
BEYOND_COST = 5.0
"""Comfort lost per metre that a palm reaches past the middle of an object to its far side."""
MIN_COMFORT = 0.45
"""Minimum comfort of a grip option."""
CLEAR_M = 0.022
"""Clearance between a palm and a handle that it does not grip, metres."""
ARM_M = np.array([0.06, 0.12, 0.18, 0.24])
HAND_RADIUS_M, ARM_RADIUS_M = 0.016, 0.034
MIRROR = np.diag([1.0, -1.0, 1.0])


@dataclass(frozen=True, eq=False)
class GripOption:
    """One hand on an object; `turn` is the index of the grip's rotation about the object's axis."""

    obj: PlacedObject
    grip: Grip
    turn: int
    comfort: float

    @property
    def side(self) -> str:
        """Side of the hand, left or right."""
        return self.grip.side

    @property
    def palm(self) -> Pose:
        """T_world_palm of the hand."""
        return self.obj.T_world_obj @ self.grip.T_obj_palm


def with_extra_grips(model: ObjectModel) -> ObjectModel:
    """Add the grips of a pan's rim, and the grip of a mug's handle from outside with the left hand."""
    if model.kind == "pan" and model.opening is not None:
        return replace(model, grips=(*model.grips, *edge(PAN_RIM, (float(model.size[0]) / 2, 0.0, model.opening[2]), 0.01)))
    if model.kind == "mug":
        right = next(grip for grip in model.grips_of("right") if grip.name == "handle")
        other = mirror_grip(right)
        left = replace(other, T_obj_palm=pose((0, 0, 0), axis_angle((0, 0, 1), np.pi)) @ other.T_obj_palm)
        rest = (grip for grip in model.grips if grip.name != "handle")
        return replace(model, grips=(*rest, right, left))
    return model


class ReachModel:
    """Reachable grips of the objects of one layout, for both hands."""

    def __init__(self, objects: Sequence[PlacedObject]) -> None:
        self.objects = list(objects)
        self._built = {obj.number: height_map([other for other in objects if other is not obj]) for obj in objects}

    def options(self, obj: PlacedObject, side: str, names: Sequence[str] = ()) -> list[GripOption]:
        """Return the best reachable option for each part and kind of grip, most comfortable first.

        `names` restricts the parts; all parts are allowed when it is empty.
        """
        best: dict[tuple[str, str], GripOption] = {}
        for option in self._candidates(obj, side, names):
            key = (option.grip.name, option.grip.kind)
            if option.comfort > MIN_COMFORT and (key not in best or option.comfort > best[key].comfort) and self._is_free(option):
                best[key] = option
        return sorted(best.values(), key=lambda option: -option.comfort)

    def _candidates(self, obj: PlacedObject, side: str, names: Sequence[str]) -> Iterator[GripOption]:
        for grip in obj.model.grips_of(side):
            if not names or grip.name in names:
                for turn, turned in enumerate(_rotated_grips(obj.model, grip)):
                    yield GripOption(obj, turned, turn, _comfort(obj.T_world_obj @ turned.T_obj_palm, obj, side))

    def _is_free(self, option: GripOption) -> bool:
        """Return True when palm, knuckles and forearm are clear of other objects and of the object's own handle."""
        points, radius = _arm_points(option)
        stands = height_at(self._built[option.obj.number], points)
        if ((stands > 0) & (points[:, 2] - radius < stands)).any():
            return False
        return _clear_of_handle(option, points[: len(ROOTS) + 1])


def _comfort(palm: Pose, obj: PlacedObject, side: str) -> float:
    """Score the comfort of a palm pose, about -2..1, with costs for crossing the body and for reaching behind the object."""
    across = float(-palm[0, 3] if side == "right" else palm[0, 3])
    beyond = float(palm[1, 3] - obj.T_world_obj[1, 3])
    return comfort(palm, side) - CROSSING_COST * max(0.0, across) - BEYOND_COST * max(0.0, beyond)


def _rotated_grips(model: ObjectModel, grip: Grip) -> Iterator[Grip]:
    shape = "round" if model.kind in ROUND_KINDS or grip.name == PAN_RIM else "square" if model.kind in SQUARE_KINDS else ""
    if not shape or grip.name in FIXED_PARTS:
        yield grip
        return
    for angle in np.arange(TURNS[shape]) * (2 * np.pi / TURNS[shape]):
        yield replace(grip, T_obj_palm=pose((0, 0, 0), axis_angle((0, 0, 1), angle)) @ grip.T_obj_palm)


def _arm_points(option: GripOption) -> tuple[np.ndarray, np.ndarray]:
    """Return world points (n, 3) at palm, knuckles, wrist and along the forearm, and the radius (n,) there, metres."""
    palm = option.palm
    local = np.concatenate([np.zeros((1, 3)), ROOTS, WRIST[None]]) @ (MIRROR if option.side == "left" else np.eye(3))
    hand = local @ palm[:3, :3].T + palm[:3, 3]
    back = elbow(option.side, palm) - hand[-1]
    arm = hand[-1] + ARM_M[:, None] * back / np.linalg.norm(back)
    return np.concatenate([hand, arm]), np.repeat([HAND_RADIUS_M, ARM_RADIUS_M], [len(hand), len(arm)])


def _clear_of_handle(option: GripOption, points: np.ndarray) -> bool:
    if option.grip.name in FIXED_PARTS:
        return True
    handles = [part.mesh.vertices for part in option.obj.model.parts if part.name in FIXED_PARTS]
    if not handles:
        return True
    T = option.obj.T_world_obj
    world = np.concatenate(handles)[::4] @ T[:3, :3].T + T[:3, 3]
    return float(np.linalg.norm(world[None] - points[:, None], axis=2).min()) > CLEAR_M


SLACK = 0.12
"""Largest difference of comfort at which the left and the right hand are equally natural."""
PART_SLACK = 0.35
"""Largest loss of comfort at which another part of the object is still natural."""
CROSSED_COST = 3.0
"""Comfort lost per metre by which the left palm is to the right of the right palm."""
COMFORT_SCALE = 0.15
"""Comfort difference that makes an option e times as likely."""
ONE_OR_TWO_HANDS = ("bowl", "pan")
"""Wide kinds that people carry with one hand or with two."""
MAX_PLANS = 6


@dataclass(frozen=True)
class GraspPlan:
    """Grip option of each hand; None for an idle hand."""

    left: GripOption | None
    right: GripOption | None
    comfort: float

    @property
    def options(self) -> tuple[GripOption | None, GripOption | None]:
        """Options of the (left, right) hand."""
        return self.left, self.right

    @property
    def taxonomy(self) -> int:
        """4-way taxonomy: 0 left, 1 right, 2 both on one object, 3 both on different objects."""
        if self.left and self.right:
            return 2 if self.left.obj is self.right.obj else 3
        return 0 if self.left else 1

    @property
    def parts(self) -> tuple[str, ...]:
        """Gripped parts, regardless of the hand."""
        return tuple(sorted(f"{option.obj.number} {option.grip.name} {option.grip.kind}" for option in self.options if option))


def grasp_plans(task: Task, reach: ReachModel) -> list[GraspPlan]:
    """Return the natural grasp plans of a task, most comfortable first; empty when the task is not feasible."""
    one = _natural(_one_hand(task, reach))
    if task.support is None:
        return one[:MAX_PLANS]
    two = _natural(_two_hands(task, reach))
    either = not task.both_required and len(task.objects) == 1 and task.kinds[0] in ONE_OR_TWO_HANDS
    chosen = [*two, *one] if either else two if two or task.both_required else one
    return sorted(chosen, key=lambda plan: -plan.comfort)[:MAX_PLANS]


def plan_weights(chosen: Iterable[GraspPlan]) -> np.ndarray:
    """Return the probability (n,) of each plan."""
    comfort = np.array([plan.comfort for plan in chosen])
    likely = np.exp((comfort - comfort.max()) / COMFORT_SCALE)
    return likely / likely.sum()


def _one_hand(task: Task, reach: ReachModel) -> list[GraspPlan]:
    parts = task.parts if task.one_hand_parts is None else task.one_hand_parts
    return [
        GraspPlan(option if side == "left" else None, option if side == "right" else None, option.comfort)
        for side in SIDES
        for option in reach.options(task.objects[0], side, parts)
    ]


def _two_hands(task: Task, reach: ReachModel) -> list[GraspPlan]:
    found: dict[tuple[str, ...], GraspPlan] = {}
    for lead, other in (SIDES, SIDES[::-1]):
        firsts, seconds = (
            reach.options(task.objects[0], lead, task.parts),
            reach.options(task.objects[-1], other, task.support or ()),
        )
        for first, second in product(firsts, seconds):
            left, right = (first, second) if lead == "left" else (second, first)
            plan = _together(left, right)
            if plan:
                found[f"{left.obj.number} {left.grip.name}", f"{right.obj.number} {right.grip.name}"] = plan
    return list(found.values())


def _together(left: GripOption, right: GripOption) -> GraspPlan | None:
    """Combine two options, with a cost for crossed arms; None when the hands would collide."""
    a, b = left.palm[:3, 3], right.palm[:3, 3]
    if np.linalg.norm(a - b) < MIN_HAND_GAP_M:
        return None
    return GraspPlan(left, right, min(left.comfort, right.comfort) - CROSSED_COST * max(0.0, float(a[0] - b[0])))


def _natural(candidates: list[GraspPlan]) -> list[GraspPlan]:
    """Keep the plans whose comfort is near the best of the same parts and near the best of all."""
    best: dict[tuple[str, ...], float] = {}
    for plan in candidates:
        best[plan.parts] = max(best.get(plan.parts, -np.inf), plan.comfort)
    limit = max(best.values(), default=0.0) - PART_SLACK
    fit = [plan for plan in candidates if plan.comfort >= max(limit, best[plan.parts] - SLACK)]
    return sorted(fit, key=lambda plan: -plan.comfort)
