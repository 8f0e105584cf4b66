"""Manipulations of an object by one hand, one function for each affordance.

Time runs from 0 to LENGTH, in thirtieths of a second. Every manipulation consists of approach, contact, motion, release and
withdrawal. The object is at rest before contact and after release.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from afford.dataset.affordance_rules import affordance_rule
from afford.render.motion import Curve, Pose, PoseAt, Track, approach, arc, axis_angle, ease, pose, sway
from afford.synthetic.assets.object_model import ObjectModel
from afford.synthetic.tabletop import hand_placement
from afford.synthetic.tabletop.hand_placement import InitialGrasp
from afford.synthetic.tabletop.tabletop_objects import CONTACT_HEIGHT_M

LENGTH, TOUCH, RELEASE = 27.0, 5.0, 22.0
SQUASH, BULGE = 0.34, 0.10
"""Share of its width that a squeezed object loses between the fingers, and gains across."""
FLEX = np.array((0.0, 0.10, 0.06, 0.04) + (0.0, 0.16, 0.12, 0.05) * 4)
"""Change of the joint angles while the squeezed object yields."""
Builder = Callable[[ObjectModel, tuple[str, ...], np.random.Generator], "Manipulation"]


@dataclass(frozen=True, eq=False)
class Manipulation:
    """Trajectories of a hand and an object."""

    hold: InitialGrasp
    object_track: Track
    held_palm: Callable[[float], Pose]
    """T_world_palm between contact and release"""
    squeeze: Curve
    """squeezing strength, 0 to 1"""
    start: Pose
    leave: Pose

    def palm(self, time: float) -> Pose:
        """Return T_world_palm at a time."""
        inward = 0.035 * self.hold.palm[:3, 2]
        if time < TOUCH:
            return approach(self.start, self.held_palm(TOUCH), np.zeros(3), inward)(time / TOUCH)
        if time <= RELEASE:
            return self.held_palm(time)
        last = self.held_palm(RELEASE)
        outward = -0.045 * last[:3, 2] + (0, 0, 0.02)
        return approach(last, self.leave, outward, np.zeros(3))((time - RELEASE) / (LENGTH - RELEASE))

    def fingers(self, time: float) -> np.ndarray:
        """Return the joint angles (20,) at a time."""
        closed = ease((time - TOUCH + 4) / 4.5) * (1 - ease((time - RELEASE + 0.5) / 2.5))
        pressed = FLEX * float(self.squeeze.at(time)[0])
        return np.asarray(self.hold.opened + closed * (self.hold.closed + pressed - self.hold.opened))

    def deform(self, points: np.ndarray, time: float) -> np.ndarray:
        """Deform points (n, 3) of the object, in its own frame, by the squeeze between thumb and fingers."""
        amount = float(self.squeeze.at(time)[0])
        across = self.hold.T_obj_palm[:3, 0] * (1, 1, 0)
        across /= max(float(np.linalg.norm(across)), 1e-9)
        middle = self.hold.T_obj_palm[:3, 3] + 0.03 * self.hold.T_obj_palm[:3, 2]
        near = np.exp(-(((points[:, 2] - middle[2]) / 0.06) ** 2))[:, None] * amount
        along = (points @ across)[:, None] * across
        return points - near * (SQUASH * along - BULGE * (points * (1, 1, 0) - along))


def manipulate(affordance: str, object_type: str, model: ObjectModel, rng: np.random.Generator) -> Manipulation:
    """Sample a manipulation of an object for an affordance."""
    return MANIPULATIONS[affordance](model, affordance_rule(object_type, affordance).grips, rng)


def grasp(model: ObjectModel, names: tuple[str, ...], rng: np.random.Generator) -> Manipulation:
    """Grasp the object, hold it in place with a tremor, and release it."""
    hold = hand_placement.grip_hold(model, names, rng)
    wander = sway(rng, 4, (9, 20))

    def still(s: float) -> Pose:
        move = np.sin(np.pi * s) ** 2 * wander(s * (RELEASE - TOUCH))
        return pose(
            hold.T_world_obj[:3, 3] + 0.003 * move[:3] * (1, 1, 0),
            axis_angle((0, 0, 1), 0.05 * float(move[3])) @ hold.T_world_obj[:3, :3],
        )

    return _rigid(hold, [(TOUCH + 1, RELEASE - 1, still)], rng)


def lift(model: ObjectModel, names: tuple[str, ...], rng: np.random.Generator) -> Manipulation:
    """Lift the object, hold it up, and put it back."""
    hold = hand_placement.grip_hold(model, names, rng)
    up = hold.T_world_obj.copy()
    up[:3, 3] += (*rng.uniform(-0.025, 0.025, 2), rng.uniform(0.08, 0.13))
    up[:3, :3] = axis_angle(rng.normal(size=3), rng.uniform(0.02, 0.22)) @ up[:3, :3]
    back = pose(hold.T_world_obj[:3, 3] + (*rng.uniform(-0.008, 0.008, 2), 0), hold.T_world_obj[:3, :3])
    return _rigid(hold, _waypoints(hold.T_world_obj, TOUCH + 0.5, (up, 12.0), (up, 15.0), (back, RELEASE - 0.5)), rng)


def push(model: ObjectModel, names: tuple[str, ...], rng: np.random.Generator) -> Manipulation:
    """Push the object across the table with the flat hand."""
    hold, ahead = hand_placement.push_hold(model, rng)
    goal = pose(
        hold.T_world_obj[:3, 3] + ahead * rng.uniform(0.07, 0.12),
        axis_angle((0, 0, 1), rng.uniform(-0.1, 0.1)) @ hold.T_world_obj[:3, :3],
    )
    return _rigid(hold, _waypoints(hold.T_world_obj, TOUCH + 0.5, (goal, RELEASE - 1)), rng, start=-0.09 * ahead, turned=False)


def rotate(model: ObjectModel, names: tuple[str, ...], rng: np.random.Generator) -> Manipulation:
    """Rotate the object about the vertical in place."""
    hold = hand_placement.grip_hold(model, names, rng)
    angle = rng.uniform(0.75, 1.25) * rng.choice([-1.0, 1.0])
    before = pose(hold.T_world_obj[:3, 3], axis_angle((0, 0, 1), -0.5 * angle) @ hold.T_world_obj[:3, :3])
    after = pose(hold.T_world_obj[:3, 3], axis_angle((0, 0, 1), 0.5 * angle) @ hold.T_world_obj[:3, :3])
    begun = InitialGrasp(hold.model, hold.side, before, hold.T_obj_palm, hold.opened, hold.closed)
    return _rigid(begun, _waypoints(before, TOUCH + 0.5, (after, RELEASE - 1.5)), rng)


def squeeze(model: ObjectModel, names: tuple[str, ...], rng: np.random.Generator) -> Manipulation:
    """Squeeze the object twice between thumb and fingers; it yields and recovers."""
    press = Curve(np.zeros(1), [])
    for start, hard in ((5.5, 1.0), (13.0, rng.uniform(0.7, 1.0))):
        press.add(start, start + 3.0, hard)
        press.add(start + 4.0, start + 7.0, 0.0)
    return _rigid(hand_placement.grip_hold(model, names, rng), [], rng, press=press)


def hammer(model: ObjectModel, names: tuple[str, ...], rng: np.random.Generator) -> Manipulation:
    """Pick up the hammer, strike the block twice, and put it back."""
    hold = hand_placement.grip_hold(model, names, rng)
    struck = _tool_pose(hold, (-0.03, 0.125), CONTACT_HEIGHT_M["hammer"] + 0.004)
    swing = rng.uniform(0.45, 0.7)
    pivot = struck[:3, 3] - 0.16 * struck[:3, 1]
    up = pose(pivot, axis_angle(np.cross(struck[:3, 1], (0, 0, 1.0)), swing))
    raised = up @ pose(-pivot) @ struck
    beats = ((raised, 9.0), (struck, 12.0), (raised, 15.0), (struck, 18.0), (hold.T_world_obj, RELEASE - 0.3))
    return _rigid(hold, _waypoints(hold.T_world_obj, TOUCH + 0.5, *beats), rng)


def cut(model: ObjectModel, names: tuple[str, ...], rng: np.random.Generator) -> Manipulation:
    """Pick up the knife, saw into the loaf, and put it back."""
    hold = hand_placement.grip_hold(model, names, rng)
    deep = _tool_pose(hold, (-0.03, 0.135), CONTACT_HEIGHT_M["knife"] - 0.012)
    stroke, strokes = deep[:3, 1] * rng.uniform(0.028, 0.04), rng.uniform(1.6, 2.2)

    def saw(s: float) -> Pose:
        out = deep.copy()
        out[:3, 3] += stroke * np.sin(2 * np.pi * strokes * s) + (0, 0, 0.03 * (1 - ease(min(1.0, 1.3 * s))))
        return out

    path = [*_waypoints(hold.T_world_obj, TOUCH + 0.5, (saw(0), 8.5)), (8.5, 18.5, saw)]
    return _rigid(hold, path + _waypoints(saw(1), 18.5, (hold.T_world_obj, RELEASE - 0.3)), rng)


def paint(model: ObjectModel, names: tuple[str, ...], rng: np.random.Generator) -> Manipulation:
    """Pick up the brush, stroke the panel from side to side, and put it back."""
    hold = hand_placement.grip_hold(model, names, rng)
    ahead = hold.T_world_obj[:3, 1]
    across = np.cross(ahead, (0, 0, 1.0))
    slope = ahead * 0.75 + (0, 0, -0.65)
    tip = hold.T_world_obj @ np.array([*(model.tip or (0, 0, 0)), 1.0])
    low = aimed_pose(model, slope, np.array([0, 0, 1.0]), tip, 0.06 * ahead, CONTACT_HEIGHT_M["brush"])
    wide, strokes = across * rng.uniform(0.045, 0.06), rng.uniform(1.3, 1.8) * rng.choice([-1.0, 1.0])

    def brush(s: float) -> Pose:
        out = low.copy()
        out[:3, 3] += wide * np.sin(2 * np.pi * strokes * s) + ahead * 0.03 * (0.5 - s)
        return out

    path = [*_waypoints(hold.T_world_obj, TOUCH + 0.5, (brush(0), 8.0)), (8.0, 18.5, brush)]
    return _rigid(hold, path + _waypoints(brush(1), 18.5, (hold.T_world_obj, RELEASE - 0.3)), rng)


def type_(model: ObjectModel, names: tuple[str, ...], rng: np.random.Generator) -> Manipulation:
    """Tap on the object with the index finger at three positions."""
    hold = hand_placement.tap_hold(model, rng)
    half = 0.5 * model.size[:2] * (0.6, 0.7)
    downs = [hold.T_world_obj[:3, :3] @ np.array([*rng.uniform(-half, half), 0.0]) for _ in range(3)]
    keys = [(k * 6.0 + dt, down + (0, 0, z)) for k, down in enumerate(downs) for dt, z in ((6.0, 0.0), (9.0, 0.035))]
    times, places = np.array([t for t, _ in keys]), np.array([p for _, p in keys])

    def tapping(time: float) -> Pose:
        k = int(np.clip(np.searchsorted(times, time) - 1, 0, len(times) - 2))
        s = ease((time - times[k]) / (times[k + 1] - times[k]))
        return pose((1 - s) * places[k] + s * places[k + 1]) @ hold.palm

    return _with_approach(hold, Track(hold.T_world_obj, []), tapping, Curve(np.zeros(1), []), rng, None)


MANIPULATIONS: dict[str, Builder] = {"grasp": grasp, "cut": cut, "lift": lift, "push": push, "rotate": rotate, "hammer": hammer,
                          "squeeze": squeeze, "paint": paint, "type": type_}  # fmt: skip


def elbow(side: str, palm: Pose) -> np.ndarray:
    """Return the position of an elbow (3,), world metres: beside the chest, shifted with the hand."""
    out = 1.0 if side == "right" else -1.0
    return np.array([0.30 * out, -0.44, 0.18]) + 0.35 * (palm[:3, 3] - (0.24 * out, -0.21, 0.11)) * (1, 1, 0.6)


def aimed_pose(
    model: ObjectModel, along: np.ndarray, up: np.ndarray, tip_at: np.ndarray, shift: np.ndarray, height_m: float
) -> Pose:
    """Return the pose of a tool with its long axis (y) along `along`, z close to `up`, and its tip above `tip_at` + `shift`."""
    y = along / np.linalg.norm(along)
    z = up - y * (y @ up)
    z /= np.linalg.norm(z)
    turned = np.stack([np.cross(y, z), y, z], axis=1)
    at = np.array([*(tip_at[:2] + shift[:2]), height_m])
    return pose(at - turned @ np.asarray(model.tip), turned)


def _tool_pose(hold: InitialGrasp, shift: tuple[float, float], height_m: float) -> Pose:
    """Return the working pose of a tool: edge or face (+x) down, its tip shifted (ahead, inwards) from where the tool lay."""
    both = hand_placement.table_axes(hold)
    place = hold.T_world_obj @ np.array([*(hold.model.tip or (0, 0, 0)), 1.0])
    return aimed_pose(hold.model, both[:, 0], -both[:, 1], place, both @ np.array(shift), height_m)


def _waypoints(first: Pose, start: float, *stops: tuple[Pose, float]) -> list[tuple[float, float, PoseAt]]:
    """Return motion segments from a pose through others at given times."""
    poses, times = [first, *(goal for goal, _ in stops)], [start, *(stop for _, stop in stops)]
    return [(times[k], times[k + 1], arc(poses[k], poses[k + 1], np.zeros(3))) for k in range(len(stops))]


def _rigid(hold: InitialGrasp, segments: list[tuple[float, float, PoseAt]], rng: np.random.Generator, *, press: Curve | None = None,
           start: np.ndarray | None = None, turned: bool = True) -> Manipulation:  # fmt: skip
    """Build a manipulation in which the hand follows the object rigidly."""
    obj = Track(hold.T_world_obj, [])
    for begin, stop, path in segments:
        obj.add(begin, stop, path)

    def held(time: float) -> Pose:
        out = obj.at(time) @ hold.T_obj_palm
        if not turned:
            out[:3, :3] = hold.palm[:3, :3]
        return out

    return _with_approach(hold, obj, held, press or Curve(np.zeros(1), []), rng, start)


def _with_approach(hold: InitialGrasp, obj: Track, held: Callable[[float], Pose], press: Curve, rng: np.random.Generator,
          start: np.ndarray | None) -> Manipulation:  # fmt: skip
    """Add approach and withdrawal to a manipulation."""
    first, last = held(TOUCH), held(RELEASE)
    body = np.array([0.22 if hold.side == "right" else -0.22, -0.55, 0.0])
    home = (body - first[:3, 3]) / np.linalg.norm(body - first[:3, 3]) * (1, 1, 0)
    away = -first[:3, 2]
    come = start if start is not None else 0.05 * away + 0.06 * home + (0, 0, 0.035)
    go = 0.04 * -last[:3, 2] + rng.uniform(0.15, 0.19) * home + (0, 0, 0.03)
    opened = pose(first[:3, 3] + come * rng.uniform(0.9, 1.25), first[:3, :3])
    left = pose(last[:3, 3] + go, last[:3, :3])
    for palm in (opened, left):
        palm[2, 3] = max(palm[2, 3], 0.055)
    return Manipulation(hold, obj, held, press, opened, left)
