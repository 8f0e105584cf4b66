"""Object trajectories shared by the scripts: carry, put down, hover, pour, aim a tool, stir."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from afford.render.motion import Pose, PoseAt, axis_angle, blend, pose, sway
from afford.synthetic.assets.object_model import Grip
from afford.synthetic.kitchens.animation import SceneObject
from afford.synthetic.kitchens.scene_builder import SceneBuilder

SPOUT_M = 0.04
"""Distance of a mouth from the middle of a vessel beyond which it is a spout that has to point at the cup, metres."""
MOST_TURN = 0.8


def set_down_pose(obj: SceneObject, place: np.ndarray, turn_rad: float, upright: Pose | None = None) -> Pose:
    """Return the pose of an object set down at `place` (3,), turned about the vertical relative to its initial pose."""
    first = obj.at(0) if upright is None else upright
    return pose(place, axis_angle((0, 0, 1), turn_rad) @ first[:3, :3])


def carry(scene: SceneBuilder, obj: SceneObject, start: float, stop: float, target: Pose, lift_m: float) -> None:
    """Lift an object, pause in the air with some tilt, and set it down at `target`."""
    begin = obj.track.end()
    middle = blend(begin, target, scene.rng.uniform(0.45, 0.65))
    middle[:3, 3] += (0.0, scene.rng.uniform(-0.05, 0.02), lift_m)
    middle[:3, :3] = axis_angle(scene.rng.normal(size=3) * (1, 1, 0.3), scene.rng.uniform(0.12, 0.35)) @ middle[:3, :3]
    length = stop - start
    reached, left = start + 0.42 * length, start + 0.58 * length
    obj.move(start, reached, middle, lift_m=0.02)
    obj.track.add(reached, left, hover(scene, middle, left - reached))
    obj.move(left, stop, target, lift_m=0.02)


def hover(scene: SceneBuilder, at: Pose, frames: float) -> PoseAt:
    """Return a motion of a held object that wanders slightly and ends where it began."""
    wander = sway(scene.rng, 6, (14, 40))

    def path(s: float) -> Pose:
        fade = np.sin(np.pi * s) ** 2
        move = fade * wander(s * frames)
        return pose(at[:3, 3] + 0.008 * move[:3], axis_angle(move[3:] + 1e-9, 0.06 * float(np.linalg.norm(move[3:]))) @ at[:3, :3])

    return path


def pouring_pose(scene: SceneBuilder, vessel: SceneObject, cup: SceneObject, tilt_rad: float) -> Pose:
    """Return the pose of a vessel that leans towards a cup, its mouth slightly above and beside the cup's mouth.

    A vessel with a spout first turns so that the spout points at the cup.
    """
    upright = vessel.at(0)[:3, :3]
    mouth = np.asarray(vessel.model.opening or (0, 0, vessel.model.size[2]), float)
    target = cup.at(0) @ np.array([*(cup.model.opening or (0, 0, cup.model.size[2])), 1.0])
    towards = np.array([-scene.mirror, 0.25, 0.0])
    if np.hypot(*mouth[:2]) > SPOUT_M:
        spout = upright @ (mouth * (1, 1, 0)) / np.hypot(*mouth[:2])
        goal = spout + 1.3 * towards
        turn = np.clip(np.arctan2(spout[0] * goal[1] - spout[1] * goal[0], spout[:2] @ goal[:2]), -MOST_TURN, MOST_TURN)
        upright = axis_angle((0, 0, 1), float(turn)) @ upright
        towards = axis_angle((0, 0, 1), float(turn)) @ spout
    towards = towards / np.linalg.norm(towards)
    turned = axis_angle(np.cross((0, 0, 1), towards), tilt_rad) @ upright
    beside = 0.03 * (1 + 2 * np.cos(tilt_rad))
    lip = target[:3] - beside * towards + (0, 0, 0.035 + 0.05 * np.cos(tilt_rad))
    return pose(lip - turned @ mouth, turned)


def aim_tool(scene: SceneBuilder, tool: SceneObject, along: np.ndarray, up: np.ndarray, tip_at: np.ndarray) -> Pose:
    """Return the pose of a tool with its tip at a point, its long axis (y, handle to tip) along `along` and z close to `up`."""
    y = along / np.linalg.norm(along)
    z = up - y * (y @ up)
    z /= np.linalg.norm(z)
    turned = np.stack([np.cross(y, z), y, z], axis=1)
    tip = np.asarray(tool.model.tip or (0, tool.model.size[1] / 2, 0))
    return pose(tip_at - turned @ tip, turned)


def roll_grip(grip: Grip, angle_rad: float, height_m: float) -> Grip:
    """Rotate a grip about the long axis (y) of a lying tool whose handle is `height_m` above the table."""
    turn = pose((0, 0, height_m)) @ pose((0, 0, 0), axis_angle((0, 1, 0), angle_rad)) @ pose((0, 0, -height_m))
    return replace(grip, T_obj_palm=turn @ grip.T_obj_palm)


def stirring_circle(start: Pose, radius_m: float, turns: float) -> PoseAt:
    """Return a stirring motion: small circles that begin and end at `start`."""

    def path(s: float) -> Pose:
        angle, grow = 2 * np.pi * turns * s, np.sin(np.pi * min(1.0, 4 * s, 4 * (1 - s)) / 2)
        out = start.copy()
        out[:3, 3] += radius_m * grow * np.array([np.cos(angle), np.sin(angle), 0.0])
        return out

    return path
