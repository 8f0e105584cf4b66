"""The actors of a clip: things with a motion, arms that take hold of them, a head, and what is said about it.

Time runs from 0 to `LENGTH`; a clip of so many frames shows one unit a frame, a shorter or longer one is faster or slower.
A script writes the motion of the things; an arm that holds one follows it rigidly, grip by grip, so that hand and object
never slip. Everything is evaluated late: a script may write what a hand does before the thing it follows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from afford.render.camera import Head
from afford.render.motion import Curve, Pose, PoseAt, Track, approach, arc
from afford.synthetic.assets.object_model import Grip, ObjectModel

LENGTH = 121.0
"""How long a play is, in units of time."""


@dataclass
class Thing:
    """An object with its motion. `track` is T_world_obj, `opened` the value of its joint."""

    name: str
    model: ObjectModel
    track: Track
    opened: Curve = field(default_factory=lambda: Curve(np.zeros(1), []))

    def at(self, time: float) -> Pose:
        """T_world_obj at a time."""
        return self.track.at(time)

    def palm(self, grip: Grip, time: float) -> Pose:
        """Where a palm is that holds the thing by `grip`, T_world_palm."""
        joint = self.model.joint
        swing = joint.T_obj_moving(float(self.opened.at(time)[0])) if grip.moving and joint else np.eye(4)
        return self.at(time) @ swing @ grip.T_obj_palm

    def move(self, start: float, stop: float, target: Pose, lift_m: float = 0.0) -> None:
        """Go to a pose (4, 4), in a bow that rises `lift_m`."""
        self.track.add(start, stop, arc(self.track.end(), target, np.array([0, 0, lift_m])))

    def open(self, start: float, stop: float, value: float) -> None:
        """Bring the joint to a value (radians or metres)."""
        self.opened.add(start, stop, value)


@dataclass(frozen=True)
class Touch:
    """A hand holds a thing from `start` to `stop`."""

    start: float
    stop: float
    thing: Thing
    grip: Grip


class Arm:
    """One arm: T_world_palm over time, and how far its fingers are closed (0 open .. 1 round the grip)."""

    def __init__(self, side: str, home: Pose) -> None:
        self.side, self.home = side, home
        self.track = Track(home, [])
        self.closed = Curve(np.zeros(1), [])
        self.touches: list[Touch] = []

    def start_holding(self, thing: Thing, grip: Grip, stop: float) -> None:
        """Hold a thing from before the clip begins."""
        self.closed.rest = np.ones(1)
        self._follow(thing, grip, 0.0, stop)

    def take(self, thing: Thing, grip: Grip, start: float, touch: float, stop: float) -> None:
        """Reach from `start`, hold from `touch` until `stop`."""
        self.track.add(start, touch, _reach(self.track.end_path(), lambda: thing.palm(grip, touch), grip))
        self.closed.add(max(start, touch - 7), touch, 1.0)
        self._follow(thing, grip, touch, stop)

    def _follow(self, thing: Thing, grip: Grip, start: float, stop: float) -> None:
        self.track.add(start, stop, lambda s: thing.palm(grip, start + s * (stop - start)))
        self.touches.append(Touch(start, stop, thing, grip))

    def go(self, start: float, stop: float, target: Pose, leave_m: float = 0.05) -> None:
        """Move freely to a pose, opening the hand; the hand first backs out of what it held."""
        before = self.track.end_path()

        def path(s: float) -> Pose:
            origin = before()
            return approach(origin, target, -leave_m * origin[:3, 2] + (0, 0, 0.02), np.zeros(3))(s)

        self.closed.add(start - 1, start + 6, 0.0)
        self.track.add(start, stop, path)

    def withdraw(self, stop: float) -> None:
        """Let go and go home, out of sight, until `stop`."""
        start = self.track.segments[-1][1]
        self.go(start, max(stop, start + 4), self.home)

    def touch_at(self, time: float) -> Touch | None:
        """What the hand holds at a time."""
        return next((touch for touch in self.touches if touch.start <= time <= touch.stop), None)


def _reach(before: Callable[[], Pose], target: Callable[[], Pose], grip: Grip) -> PoseAt:
    def path(s: float) -> Pose:
        goal = target()
        inward = goal[:3, 0] if grip.kind == "flat_edge" else goal[:3, 2]
        return approach(before(), goal, np.zeros(3), 0.07 * inward - (0, 0, 0.015))(s)

    return path


@dataclass(frozen=True)
class Saying:
    """One narration: the interval in play time, the sentence, the verb and the nouns, the acted-on one first."""

    start: float
    stop: float
    text: str
    verb: str
    nouns: tuple[str, ...]


@dataclass
class Play:
    """Everything that happens in one clip."""

    head: Head
    arms: dict[str, Arm]
    things: list[Thing] = field(default_factory=list)
    sayings: list[Saying] = field(default_factory=list)
    hard: tuple[str, ...] = ()

    def say(self, start: float, stop: float, text: str, verb: str, *things: Thing) -> None:
        """Narrate an action."""
        self.sayings.append(Saying(start, stop, text, verb, tuple(thing.model.noun for thing in things)))
