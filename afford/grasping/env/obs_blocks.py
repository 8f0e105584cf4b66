"""Observation blocks: groups of numbers from which the observation of a role is concatenated, by the table LAYOUTS.

R are blocks of the robot, O of the object's state, P of the object's points, N of the negative points. As in AffordDex, the prior
observes R O P, the teacher R O P N, the student R P N. The layout `small` is for MLPs that train in minutes: places, spreads and
distances in the frame of the episode. `paper` has the 300 published numbers in their order, in the yaw of the palm ("repose_z")
about the episode's origin, and 300 of N. `points` replaces the paper's object feature by point clouds from the palm, for PointNets.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from afford.common.arrays import like, mapped, namespace, number, single
from afford.grasping.env.measures import Measures, nearest
from afford.grasping.env.rotations import rotation_matrix, turned_euler, turned_quaternion
from afford.grasping.env.scenery import OBJECT_POINTS, EpisodeFrame, Scenery, palm_yaw, to_frame
from afford.grasping.env.task import NEGATIVE_POINTS
from afford.grasping.hand.kinematics import commanded_columns, forward_kinematics, jacobian, joint_constants
from afford.grasping.sim.engine import State


@dataclass(frozen=True, eq=False)
class Snapshot:
    """State of n worlds that observation blocks are computed from."""

    scenery: Scenery
    episode: EpisodeFrame
    state: State
    measures: Measures
    action: np.ndarray
    """(n, m) last action"""
    offset: np.ndarray
    """(n, m) offsets of the targets by actions so far, in full actions"""
    lag: np.ndarray
    """(n, m) targets minus joints, in full actions"""
    phase: np.ndarray
    """(n,) share of the episode that has passed"""

    def spot(self, points: np.ndarray, yaw: np.ndarray) -> np.ndarray:
        """(n, ..., 3) world points, relative to the episode's origin and along axes turned by yaw (n,)."""
        origin = self.episode.origin.reshape(-1, *[1] * (points.ndim - 2), 3)
        return to_frame(points - origin, yaw)

    @property
    def palm_yaw(self) -> np.ndarray:
        """(n,) yaw of the fingers (scenery.palm_yaw)."""
        return palm_yaw(self.scenery.hand, self.state)


@dataclass(frozen=True)
class Block:
    """Named group of numbers of an observation."""

    name: str
    width: int
    doc: str
    compute: Callable[[Snapshot], np.ndarray]
    """-> (n, ...) with `width` numbers per world"""


def rotation_columns(quaternion: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """Quaternions (n, 4) -> (n, 6) first two columns of the rotations, along axes turned by yaw."""
    R = rotation_matrix(quaternion)
    return to_frame(R.swapaxes(1, 2)[:, :2], yaw).reshape(len(R), 6)


def mean_and_std(points: np.ndarray, chosen: np.ndarray, origin: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """(n, 6) mean, relative to `origin` (n, 3), and standard deviation of the chosen (n, k) of points (n, k, 3); 0 without any."""
    xp, chosen = namespace(points), number(chosen)
    weight = chosen / chosen.sum(1, keepdims=True).clip(min=1)
    local = to_frame(points - origin[:, None], yaw)
    mean = xp.einsum("nk,nki->ni", weight, local)
    around = xp.einsum("nk,nki->ni", weight, (local - mean[:, None]) ** 2)
    found: np.ndarray = xp.concatenate([mean, xp.sqrt(around)], axis=1)
    return found


FAR_M = 0.3
"""distances are clipped to it"""
PRESS_N = 5.0
"""unit of forces, which are clipped to 2 units"""


def _together(parts: Sequence[np.ndarray]) -> np.ndarray:
    """Concatenate (n, d) numbers."""
    found: np.ndarray = namespace(parts[0]).concatenate(parts, axis=1)
    return found


def _everywhere(points: np.ndarray) -> np.ndarray:
    """(n, k) ones, to choose all of points (n, k, 3)."""
    found: np.ndarray = namespace(points).ones_like(points[..., 0])
    return found


def _fingers_q(now: Snapshot) -> np.ndarray:
    return now.state.q[:, 6:]


def _palm(now: Snapshot) -> np.ndarray:
    yaw = now.episode.yaw
    parts = (now.spot(now.scenery.palm(now.state), yaw), rotation_columns(now.state.palm[:, 3:], yaw))
    return _together(parts)


def _press(force: np.ndarray) -> np.ndarray:
    return (force / PRESS_N).clip(0, 2)


def _object(now: Snapshot) -> np.ndarray:
    yaw, state = now.episode.yaw, now.state
    centre = now.scenery.centre(state)
    parts = (now.spot(centre, yaw), rotation_columns(state.body[:, 3:], yaw), to_frame(state.velocity, yaw),
             0.2 * to_frame(state.spin, yaw), to_frame(now.episode.goal - centre, yaw))  # fmt: skip
    return _together(parts)


def _whole(now: Snapshot) -> np.ndarray:
    points = now.scenery.points(now.state)
    return mean_and_std(points, _everywhere(points), now.scenery.palm(now.state), now.episode.yaw)


def _allowed(now: Snapshot) -> np.ndarray:
    return mean_and_std(now.scenery.points(now.state), now.scenery.allowed, now.scenery.palm(now.state), now.episode.yaw)


def _to_surface(now: Snapshot) -> np.ndarray:
    found = nearest(now.state.tips, now.scenery.points(now.state))[1]
    return to_frame(found - now.state.tips, now.episode.yaw).clip(-FAR_M, FAR_M)


def _negative(now: Snapshot) -> np.ndarray:
    points = now.scenery.negative_points(now.state)
    there = _everywhere(points) * now.scenery.any_negative[:, None]
    return mean_and_std(points, there, now.scenery.palm(now.state), now.episode.yaw)


def _tips_negative(now: Snapshot) -> np.ndarray:
    return now.measures.N_m.clip(max=FAR_M)


def _phase(now: Snapshot) -> np.ndarray:
    xp = namespace(now.phase)
    found: np.ndarray = xp.stack([now.phase, xp.cos(np.pi * now.phase)], axis=1)
    return found


SMALL: Mapping[str, tuple[Block, ...]] = {
    "R": (
        Block("joints", 22, "joints of the fingers, rad", _fingers_q),
        Block("palm", 9, "middle of the palm; two columns of its rotation", _palm),
        Block("tips", 15, "fingertips, m", lambda now: now.spot(now.state.tips, now.episode.yaw)),
        Block("press", 6, "force of each finger and of the palm on the object, in units of 5 N",
              lambda now: _press(now.state.force.sum(axis=2))),
        Block("offset", 24, "offsets of the targets by actions so far, in full actions", lambda now: now.offset),
        Block("lag", 18, "the fingers' targets minus joints, in full actions, clipped to 5",
              lambda now: now.lag[:, 6:].clip(-5, 5)),
        Block("phase", 2, "share of the episode that has passed, and the cosine of pi times it", _phase),
    ),
    "O": (Block("object", 18, "centre of mass; two columns of its rotation; velocity; angular velocity x 0.2; vector to the goal",
                _object),),
    "P": (
        Block("whole", 6, "points of the object: mean, relative to the middle of the palm, and standard deviation, m", _whole),
        Block("tips_object", 5, "distances from fingertips to the surface, m, clipped to 0.3",
              lambda now: now.measures.tips_m.clip(max=FAR_M)),
        Block("to_surface", 15, "vectors from each fingertip to the nearest point of the surface, m", _to_surface),
    ),
    "N": (
        Block("negative", 6, "negative points: mean, relative to the middle of the palm, and standard deviation, m; 0 without any",
              _negative),
        Block("allowed", 6, "the same for the object's points that are farther than 2 cm from all negative points", _allowed),
        Block("tips_N", 5, "distances from fingertips to the nearest negative point, m, clipped to 0.3", _tips_negative),
        Block("press_N", 6, "force of each finger and of the palm on parts that are negative by N_t, in units of 5 N",
              lambda now: _press(now.measures.force_told)),
        Block("any_negative", 1, "1 where the task has negative points, else 0",
              lambda now: number(now.scenery.any_negative[:, None])),
    ),
}  # fmt: skip


def _all_torques(now: Snapshot) -> np.ndarray:
    """Torques of the finger joints; coupled joints have no motor and show 0."""
    out = namespace(now.state.q).zeros_like(now.state.q)
    out[:, like(commanded_columns(now.scenery.hand.joints), out)] = now.state.torque
    found: np.ndarray = 10.0 * out[:, 6:]
    return found


def _tips(now: Snapshot) -> np.ndarray:
    """(n, f, 13) pose, velocity and angular velocity of the fingertips, by the hand's kinematics."""
    hand, q, qd = now.scenery.hand, now.state.q, now.state.qd
    joints, xp, yaw = mapped(joint_constants(hand.joints), lambda x: like(x, q)), namespace(q), now.palm_yaw
    links, tip_m, T = like(hand.fingers.tip_link, q), like(hand.fingers.tip_m, q), forward_kinematics(joints, q)
    quaternion = xp.stack([turned_quaternion(-yaw, T[:, link, :3, :3]) for link in hand.fingers.tip_link.tolist()], axis=1)
    velocity = xp.einsum("nfid,nd->nfi", jacobian(joints, T, links, tip_m), qd)
    axis = xp.einsum("ndij,dj->ndi", T[:, joints.carried, :3, :3], joints.moving_axis)
    carries = number(joints.ancestry[links][:, joints.carried] * joints.turns)
    spin = xp.einsum("fd,ndi,nd->nfi", carries, axis, qd)
    found: np.ndarray = xp.concatenate([now.spot(now.state.tips, yaw), quaternion, to_frame(velocity, yaw), to_frame(spin, yaw)],
                                       axis=2)  # fmt: skip
    return found


def _tip_forces(now: Snapshot) -> np.ndarray:
    """(n, f, 6) contact wrenches; the engines give only the size of a force, which is the first number, the others are 0."""
    press = 10.0 * now.state.force[:, :-1].sum(axis=2)
    xp = namespace(press)
    found: np.ndarray = xp.stack([press, *[xp.zeros_like(press)] * 5], axis=2)
    return found


def _palm_euler(now: Snapshot) -> np.ndarray:
    yaw = now.palm_yaw
    return _together((now.spot(now.state.palm[:, :3], yaw), turned_euler(-yaw, now.state.palm[:, 3:])))


def _paper_object(now: Snapshot) -> np.ndarray:
    yaw, state = now.palm_yaw, now.state
    turned = turned_quaternion(-yaw, state.body[:, 3:])
    away = now.episode.goal - now.scenery.centre(state)
    parts = (now.spot(state.body[:, :3], yaw), turned, to_frame(state.velocity, yaw), 0.2 * to_frame(state.spin, yaw),
             to_frame(away, yaw))  # fmt: skip
    return _together(parts)


def _nothing(now: Snapshot, width: int) -> np.ndarray:
    xp = namespace(now.phase)
    found: np.ndarray = xp.tile(xp.zeros_like(now.phase)[:, None], (1, width))
    return found


def _cloud(now: Snapshot, points: np.ndarray) -> np.ndarray:
    return to_frame(points - now.scenery.palm(now.state)[:, None], now.palm_yaw)


ROBOT = (
    Block("q", 22, "joints of the fingers, rad", _fingers_q),
    Block("qd", 22, "speeds of these joints x 0.2", lambda now: 0.2 * now.state.qd[:, 6:]),
    Block("torque", 22, "torques of their motors x 10; 0 for the four joints without a motor", _all_torques),
    Block("tips", 65, "each fingertip: position, quaternion, velocity, angular velocity", _tips),
    Block("tip_force", 30, "each finger: contact force x 10; five numbers that the engines do not report are 0", _tip_forces),
    Block("palm", 6, "position and Euler angles (xyz) of the palm", _palm_euler),
    Block("action", 24, "last action", lambda now: now.action),
)
OBJECT = Block("object", 16, "pose, velocity, angular velocity x 0.2, vector from its centre of mass to the goal", _paper_object)
CLOUD_N = Block("N_t", 3 * NEGATIVE_POINTS,
                "negative points, relative to the palm; all at the object's origin in tasks without any",
                lambda now: _cloud(now, now.scenery.negative_points(now.state)))  # fmt: skip
CLOUD_OBJECT = Block("points", 3 * OBJECT_POINTS, "surface points of the object, relative to the palm",
                     lambda now: _cloud(now, now.scenery.points(now.state)))  # fmt: skip
UNUSED = Block("unused", 29, "zero, as published", lambda now: _nothing(now, 29))
FEATURE = Block("feature", 64, "features of an object encoder whose weights are not published: zero, as in the published imitator",
                lambda now: _nothing(now, 64))  # fmt: skip


LAYOUTS: Mapping[str, Mapping[str, tuple[Block, ...]]] = {
    "small": SMALL,
    "paper": {"R": ROBOT, "O": (OBJECT,), "P": (UNUSED, FEATURE), "N": (CLOUD_N,)},
    "points": {"R": ROBOT, "O": (OBJECT,), "P": (CLOUD_OBJECT,), "N": (CLOUD_N,)},
}
ROLES: Mapping[str, str] = {"prior": "ROP", "teacher": "ROPN", "student": "RPN"}
LIMIT = 100.0
"""observations are clipped to it, which bounds the contact forces of a diverging engine"""


def obs_blocks(layout: str, role: str) -> tuple[Block, ...]:
    """Blocks of an observation, in order. ValueError for an unknown layout or role."""
    if layout not in LAYOUTS or role not in ROLES:
        raise ValueError(f"observation: expected a layout of {', '.join(LAYOUTS)} and a role of {', '.join(ROLES)}, "
                         f"got {layout!r} and {role!r}")
    return tuple(block for group in ROLES[role] for block in LAYOUTS[layout][group])


def block_slices(chosen: Sequence[Block]) -> dict[str, slice]:
    """Columns of each block."""
    ends = np.cumsum([block.width for block in chosen]).tolist()
    return {block.name: slice(end - block.width, end) for block, end in zip(chosen, ends, strict=True)}


def observe(chosen: Sequence[Block], now: Snapshot) -> np.ndarray:
    """Compute observations (n, d) float32. ValueError for a block whose width differs because the hand is no Shadow Hand."""
    parts = [block.compute(now).reshape(len(now.phase), -1) for block in chosen]
    wrong = [(block, part) for block, part in zip(chosen, parts, strict=True) if part.shape[1] != block.width]
    if wrong:
        block, part = wrong[0]
        raise ValueError(f"observation, {block.name}: expected {block.width} numbers, as the Shadow Hand gives, "
                         f"got {part.shape[1]}")
    found: np.ndarray = single(_together(parts).clip(-LIMIT, LIMIT))
    return found
