"""Scripted grasp of a part of an object on the table: descend, close, lift, hold. The baseline for learned policies.

The hand comes down across the part's long axis, at the place nearest to the object's centre of mass, with the thumb towards that
centre. The palm faces down and sideways. Seventeen numbers describe the rest; a search on a few objects found them
(benchmarks/search_grasp.py).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from afford.grasping.hand.kinematics import commanded_columns, commanded_joints, coupling_matrix
from afford.grasping.sim.engine import CONTROL_S, State, World
from afford.grasping.sim.scene import Scene, centre

SETTLE, DESCEND, CLOSE, LIFT, HOLD = 8, 8, 10, 12, 4
"""control steps of 0.05 s: the object comes to rest, then 0.4 s, 0.5 s, 0.6 s and 0.2 s"""
ABOVE_M, LIFT_M = 0.12, 0.15
END_M = 0.04
"""distance of the aim from the ends of the part, or of the object"""
SLICE_M = 0.025
"""points within this distance along the object, both ways, are grasped together"""
NEAR_M = 0.05
"""held: the centre of mass ends this near to its rest position lifted by LIFT_M"""
UP = np.array([0.0, 0.0, 1.0])
FINGERS, THUMB = ("FF", "MF", "RF", "LF"), ("THJ4", "THJ3", "THJ2", "THJ1", "THJ0")


@dataclass(frozen=True)
class Grasp:
    """Parameters of the script."""

    grip_m: tuple[float, float, float]
    """point in the palm frame that is brought to the aim"""
    roll_rad: float
    """tilt of the fingers; pi is straight down"""
    yaw_rad: float
    pitch_rad: float
    open_base_rad: float
    """J2 of the four fingers during the descent"""
    open_middle_rad: float
    """J1"""
    open_thumb: float
    """share of the closed thumb's THJ3 and THJ0 during the descent"""
    base_rad: float
    """J2 target of the four fingers, closed; contact stops them earlier"""
    middle_rad: float
    thumb_rad: tuple[float, float, float, float, float]
    """THJ4 to THJ0, closed"""
    sink_m: float
    """further descent of the wrist while closing"""


GRASP = Grasp(grip_m=(0.0209, -0.0693, 0.1155), roll_rad=1.8787, yaw_rad=0.101, pitch_rad=-0.0298, open_base_rad=0.3564,
              open_middle_rad=0.6395, open_thumb=0.8094, base_rad=0.927, middle_rad=1.1046,
              thumb_rad=(0.4743, 1.2387, 0.0903, 0.1551, -0.7246), sink_m=0.0114)  # fmt: skip
"""result of benchmarks/search_grasp.py; MuJoCo's settings have changed slightly since, so a new search ends nearby"""


class Aim(NamedTuple):
    """Target of a grasp."""

    place: np.ndarray
    """(3,) m, world"""
    yaw: float
    """of the axis that is grasped across; the thumb is on its positive side"""


@dataclass(frozen=True, eq=False)
class Outcome:
    """Result of a scripted grasp."""

    held: bool
    gripped: bool
    """the thumb and another finger press on the object after closing"""
    shoved_m: float
    """displacement of the centre of mass until then"""
    rise_m: float
    """of the centre of mass"""
    away_m: float
    """distance of the centre of mass from its intended position"""
    penetration_m: np.ndarray
    """(k,) deepest penetration of hand and object, after each control step since first contact"""
    force: np.ndarray
    """(p,) N of the hand on each part, at the end"""
    force_most: np.ndarray
    """(p,) maximum over all steps"""


def grasp_commands(scene: Scene, aim: Aim, grasp: Grasp) -> Iterator[np.ndarray]:
    """Yield the commands (m,) of descend, close, lift and hold."""
    return wrist_commands(scene, grasp, _wrist(aim, grasp), UP)


def wrist_commands(scene: Scene, grasp: Grasp, wrist: np.ndarray, back: np.ndarray) -> Iterator[np.ndarray]:
    """Yield the same commands for a wrist (6,) at the grasp.

    The hand moves against `back` (3,), and lifts straight up.
    """
    away = np.concatenate([back, np.zeros(3)])
    above, sunk = ABOVE_M * away, -grasp.sink_m * away
    up = np.array([0, 0, LIFT_M, 0, 0, 0])
    opened, closed = _fingers(scene, grasp, closed=False), _fingers(scene, grasp, closed=True)
    for s in _ramp(DESCEND):
        yield np.concatenate([wrist + (1 - s) * above, opened])
    for s in _ramp(CLOSE):
        yield np.concatenate([wrist + s * sunk, opened + s * (closed - opened)])
    for s in _ramp(LIFT):
        yield np.concatenate([wrist + sunk + s * up, closed])
    for _ in range(HOLD):
        yield np.concatenate([wrist + sunk + up, closed])


def aim_at_part(scene: Scene, body: np.ndarray, part: int) -> Aim:
    """Aim at the middle of a part of an object at rest at the pose (7,), as near to the centre of mass as the part extends.

    The yaw is that of the part's long axis, towards that centre.
    """
    found = scene.body
    spots, weight = _spots(scene, body, found.point_part == part), centre(found, body)
    middle = spots.mean(0)
    axis = np.linalg.svd((spots - middle)[:, :2], full_matrices=False)[2][0]
    axis = axis if axis @ (weight - middle)[:2] >= 0 else -axis
    reach = (spots - middle)[:, :2] @ axis
    low, high = min(0.0, reach.min() + END_M), max(0.0, reach.max() - END_M)
    place = middle.copy()
    place[:2] += float(np.clip((weight - middle)[:2] @ axis, low, high)) * axis
    return Aim(place, float(np.arctan2(axis[1], axis[0])))


def aim_along_axis(scene: Scene, body: np.ndarray, along_m: float) -> Aim:
    """Aim at a distance from the centre of mass along the object's long axis, whose yaw is in -90..90 degrees.

    The aim ignores parts and stays away from the object's ends.
    """
    spots, weight = _spots(scene, body, np.ones(len(scene.body.points), bool)), centre(scene.body, body)
    axis = np.linalg.svd((spots - spots.mean(0))[:, :2], full_matrices=False)[2][0]
    axis = axis if axis[0] > 0 or (axis[0] == 0 and axis[1] > 0) else -axis
    reach = (spots - weight)[:, :2] @ axis
    chosen = float(np.clip(along_m, min(0.0, reach.min() + END_M), max(0.0, reach.max() - END_M)))
    near = np.abs(reach - chosen) <= SLICE_M
    place = spots[near if near.any() else np.abs(reach - chosen).argmin()[None]].mean(0)
    place[:2] += (chosen - (place - weight)[:2] @ axis) * axis
    return Aim(place, float(np.arctan2(axis[1], axis[0])))


def start_joints(scene: Scene, aim: Aim, grasp: Grasp) -> np.ndarray:
    """Return the (d,) joints before the descent of `grasp_commands`."""
    return joints_before(scene, grasp, _wrist(aim, grasp), UP)


def joints_before(scene: Scene, grasp: Grasp, wrist: np.ndarray, back: np.ndarray) -> np.ndarray:
    """Return the (d,) joints before `wrist_commands`."""
    u = np.concatenate([wrist, _fingers(scene, grasp, closed=False)])
    u[:3] += ABOVE_M * back
    A, b = coupling_matrix(scene.hand.joints)
    return A @ u + b


def grasp_part(world: World, scene: Scene, body: np.ndarray, part: int, grasp: Grasp) -> Outcome:
    """Settle the object from the pose (7,), grasp its part and lift it; the world stays as it is at the end."""
    state = settle(world, scene, start_joints(scene, aim_at_part(scene, body, part), grasp), body)
    return run_commands(world, scene, state, grasp_commands(scene, aim_at_part(scene, state.body, part), grasp))


def settle(world: World, scene: Scene, q: np.ndarray, body: np.ndarray) -> State:
    """Let the object come to rest from the pose (7,) while the hand stays at q (d,)."""
    state = world.reset(q, body)
    for _ in range(SETTLE):
        state = world.step(q[commanded_columns(scene.hand.joints)], CONTROL_S)
    return state


def run_commands(world: World, scene: Scene, state: State, commands: Iterable[np.ndarray]) -> Outcome:
    """Run the commands (m,) of `wrist_commands` from a state at rest, and measure the outcome."""
    rest = centre(scene.body, state.body)
    states = [state := world.step(u, CONTROL_S) for u in commands]
    on_parts = np.array([state.force.sum(axis=0) for state in states])
    closed, end = states[DESCEND + CLOSE - 1], centre(scene.body, states[-1].body)
    pressed = closed.force[:-1].sum(axis=1) > 0
    away = float(np.linalg.norm(end - rest - (0, 0, LIFT_M)))
    return Outcome(
        held=away < NEAR_M and states[-1].contacts > 0, gripped=bool(pressed[0] and pressed[1:].any()),
        shoved_m=float(np.linalg.norm(centre(scene.body, closed.body) - rest)), rise_m=float(end[2] - rest[2]), away_m=away,
        penetration_m=np.array([state.penetration_m for state in states if state.contacts]), force=on_parts[-1],
        force_most=on_parts.max(axis=0))  # fmt: skip


def _spots(scene: Scene, body: np.ndarray, which: np.ndarray) -> np.ndarray:
    """Return the (k, 3) points of the object at the pose (7,)."""
    spots: np.ndarray = Rotation.from_quat(body[3:]).apply(scene.body.points[which].astype(float)) + body[:3]
    return spots


def _wrist(aim: Aim, grasp: Grasp) -> np.ndarray:
    """Return the (6,) gantry joints at the grasp.

    The angles rotate about z, then y, then x; the palm's x, its thumb, points along the part.
    """
    turned = (aim.yaw + grasp.yaw_rad + np.pi) % (2 * np.pi) - np.pi
    R = Rotation.from_euler("ZYX", [turned, grasp.pitch_rad, grasp.roll_rad])
    return np.array([*(aim.place - R.apply(grasp.grip_m)), turned, grasp.pitch_rad, grasp.roll_rad])


def _fingers(scene: Scene, grasp: Grasp, closed: bool) -> np.ndarray:
    """Return the motor targets of the fingers, in the order of the hand."""
    share = 1.0 if closed else grasp.open_thumb
    value = dict(zip(THUMB, np.array(grasp.thumb_rad) * [1.0, share, 1.0, 1.0, share], strict=True))
    for finger in FINGERS:
        value[f"{finger}J2"] = grasp.base_rad if closed else grasp.open_base_rad
        value[f"{finger}J1"] = grasp.middle_rad if closed else grasp.open_middle_rad
    names = [scene.hand.joints.name[k] for k in commanded_joints(scene.hand.joints)][6:]
    return np.array([value.get(name, 0.0) for name in names])


def _ramp(count: int) -> np.ndarray:
    """Return 1/count to 1, eased at both ends."""
    s = np.arange(1, count + 1) / count
    return s * s * (3 - 2 * s)
