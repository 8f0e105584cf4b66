"""Animation of one clip: object trajectories, arm trajectories that follow them, head motion and narrations.

Animation time runs from 0 to `DURATION`. A clip of n frames samples it evenly, so a short clip shows faster motion.

A script defines the motion of the objects. An arm that holds an object follows it rigidly, so hand and object never slip. Arm
poses are evaluated lazily, so a script may define a grasp before the motion of the grasped object.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from afford.render.camera import Head
from afford.render.motion import Curve, Pose, PoseAt, Track, approach, arc
from afford.synthetic.assets.object_model import Grip, ObjectModel

DURATION = 121.0
"""Length of an animation, in units of animation time."""


@dataclass
class SceneObject:
    """Object with a trajectory: `track` is T_world_obj over time, `opened` the value of its joint over time."""

    name: str
    model: ObjectModel
    track: Track
    opened: Curve = field(default_factory=lambda: Curve(np.zeros(1), []))

    def at(self, time: float) -> Pose:
        """Return T_world_obj at a time."""
        return self.track.at(time)

    def palm_pose(self, grip: Grip, time: float) -> Pose:
        """Return T_world_palm of a palm that holds the object by `grip` at a time."""
        joint = self.model.joint
        swing = joint.T_obj_moving(float(self.opened.at(time)[0])) if grip.moving and joint else np.eye(4)
        return self.at(time) @ swing @ grip.T_obj_palm

    def move(self, start: float, stop: float, target: Pose, lift_m: float = 0.0) -> None:
        """Add a motion to a target pose (4, 4), along an arc that rises by `lift_m` metres."""
        self.track.add(start, stop, arc(self.track.end(), target, np.array([0, 0, lift_m])))

    def open(self, start: float, stop: float, value: float) -> None:
        """Add a motion of the joint to a value (radians or metres)."""
        self.opened.add(start, stop, value)


@dataclass(frozen=True)
class GripInterval:
    """Time interval during which a hand holds an object by a grip."""

    start: float
    stop: float
    obj: SceneObject
    grip: Grip


class ArmMotion:
    """Trajectory of one arm: T_world_palm over time, and finger closure over time (0 open, 1 closed on the object)."""

    def __init__(self, side: str, home: Pose) -> None:
        self.side, self.home = side, home
        self.track = Track(home, [])
        self.closed = Curve(np.zeros(1), [])
        self.grip_intervals: list[GripInterval] = []

    def hold_from_start(self, obj: SceneObject, grip: Grip, stop: float) -> None:
        """Hold an object from before the clip begins until `stop`."""
        self.closed.rest = np.ones(1)
        self._follow(obj, grip, 0.0, stop)

    def grasp(self, obj: SceneObject, grip: Grip, start: float, touch: float, stop: float) -> None:
        """Reach for an object from `start`, make contact at `touch` and hold it until `stop`."""
        self.track.add(start, touch, _reach(self.track.end_path(), lambda: obj.palm_pose(grip, touch), grip))
        self.closed.add(max(start, touch - 7), touch, 1.0)
        self._follow(obj, grip, touch, stop)

    def _follow(self, obj: SceneObject, grip: Grip, start: float, stop: float) -> None:
        self.track.add(start, stop, lambda s: obj.palm_pose(grip, start + s * (stop - start)))
        self.grip_intervals.append(GripInterval(start, stop, obj, grip))

    def move_to(self, start: float, stop: float, target: Pose, leave_m: float = 0.05) -> None:
        """Move freely to a pose and open the hand. The hand first backs away from the object that it held."""
        before = self.track.end_path()

        def path(s: float) -> Pose:
            origin = before()
            return approach(origin, target, -leave_m * origin[:3, 2] + (0, 0, 0.02), np.zeros(3))(s)

        self.closed.add(start - 1, start + 6, 0.0)
        self.track.add(start, stop, path)

    def retract(self, stop: float) -> None:
        """Release the object and return to the home pose, out of view, by `stop`."""
        start = self.track.segments[-1][1]
        self.move_to(start, max(stop, start + 4), self.home)

    def grip_at(self, time: float) -> GripInterval | None:
        """Return the grip interval that contains a time, or None."""
        return next((interval for interval in self.grip_intervals if interval.start <= time <= interval.stop), None)


def _reach(before: Callable[[], Pose], target: Callable[[], Pose], grip: Grip) -> PoseAt:
    def path(s: float) -> Pose:
        goal = target()
        inward = goal[:3, 0] if grip.kind == "flat_edge" else goal[:3, 2]
        return approach(before(), goal, np.zeros(3), 0.07 * inward - (0, 0, 0.015))(s)

    return path


@dataclass(frozen=True)
class NarratedAction:
    """Narrated action: time interval, sentence, verb and nouns, with the manipulated noun first."""

    start: float
    stop: float
    text: str
    verb: str
    nouns: tuple[str, ...]


@dataclass
class Animation:
    """Moving elements of one clip: head, arms and objects, with the narrations."""

    head: Head
    arms: dict[str, ArmMotion]
    objects: list[SceneObject] = field(default_factory=list)
    narrations: list[NarratedAction] = field(default_factory=list)
    hard: tuple[str, ...] = ()

    def narrate(self, start: float, stop: float, text: str, verb: str, *objects: SceneObject) -> None:
        """Add the narration of an action."""
        self.narrations.append(NarratedAction(start, stop, text, verb, tuple(obj.model.noun for obj in objects)))
