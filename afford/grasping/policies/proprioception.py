"""What a robot knows of itself: its joints, motors, touch and commands, and where it began. Nothing of any object.

Its frame is that of its start: the origin is the point of the table below the middle of the palm, x points where the fingers did.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from afford.grasping.env.act import turned
from afford.grasping.env.measures import Measures
from afford.grasping.env.moment import Now
from afford.grasping.env.observe import LAYOUTS, observe
from afford.grasping.env.scenery import Episode, Scenery, palm_yaw, to_world
from afford.grasping.hand.kinematics import forward_kinematics, points_on_links
from afford.grasping.sim.engine import State
from schemas.hand import HandModel


@dataclass(frozen=True, eq=False)
class Start:
    """Where n hands were when their episodes began."""

    origin: np.ndarray
    """(n, 3) m, world: below the middle of the palm, on the table"""
    yaw: np.ndarray
    """(n,) of the fingers, seen from above"""


@dataclass(frozen=True, eq=False)
class Proprioception:
    """n robots now."""

    q: np.ndarray
    """(n, d) joints"""
    qd: np.ndarray
    """(n, d)"""
    torque: np.ndarray
    """(n, m) of the motors"""
    press_n: np.ndarray
    """(n, f + 1) N on each finger, and last on the rest of the hand"""
    moved: np.ndarray
    """(n, m) how far actions have moved the targets, m or rad, along the axes of the world"""
    action: np.ndarray
    """(n, m) the last, as it moved them: m or rad, along the axes of the world"""
    lag: np.ndarray
    """(n, m) from joints to their targets, in full actions"""
    phase: np.ndarray
    """(n,) share of the episode that is over"""


def sensed(now: Now, rates: np.ndarray) -> Proprioception:
    """What the robots' own sensors and commands say; `rates` (m,) of a full action. Which part is pressed on, no sensor says."""
    state, yaw = now.state, now.episode.yaw
    return Proprioception(state.q, state.qd, state.torque, state.force.sum(axis=2), turned(now.offset * rates, yaw),
                          turned(now.action * rates, yaw), now.lag, now.phase)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Body:
    """What a robot is: its hand and what a full action moves."""

    hand: HandModel
    palm_offset: np.ndarray
    """(3,) the middle of the palm, in its frame"""
    rates: np.ndarray
    """(m,) by how much a full action moves each target, m or rad"""

    def palm(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(n, d) -> pose of the palm (n, 7), its middle (n, 3)."""
        T = forward_kinematics(self.hand.joints, q)[:, self.hand.palm]
        pose = np.concatenate([T[:, :3, 3], Rotation.from_matrix(T[:, :3, :3]).as_quat()], axis=1)
        return pose, to_world(pose, np.tile(self.palm_offset, (len(q), 1, 1)))[:, 0]

    def start(self, own: Proprioception) -> Start:
        """Of hands that begin now."""
        return Start(self.palm(own.q)[1] * (1, 1, 0), palm_yaw(self.hand, self._state(own)))

    def numbers(self, layout: str, own: Proprioception, start: Start) -> np.ndarray:
        """(n, r) float32: the blocks R of a layout of observe.py, in the frame of the start. Whatever these blocks would look up
        of an object is not a number.
        """
        state = self._state(own)
        nothing = np.full((len(own.q), 1, 3), np.nan)
        known: dict[str, Any] = {"hand": self.hand, "palm_offset": self.palm_offset}
        scenery = Scenery(**({f.name: nothing for f in fields(Scenery)} | known))
        measures = Measures(**{f.name: nothing for f in fields(Measures)})
        episode = Episode(start.origin, start.yaw, nothing[:, 0])
        now = Now(scenery, episode, state, measures, self.own(own.action, start), self.own(own.moved, start), own.lag, own.phase)
        return observe(LAYOUTS[layout]["R"], now)

    def own(self, moved: np.ndarray, start: Start) -> np.ndarray:
        """(n, m) moves along the axes of the world -> in full actions along those of the start."""
        found: np.ndarray = turned(moved, -start.yaw) / self.rates
        return found

    def world(self, action: np.ndarray, start: Start) -> np.ndarray:
        """(n, m) the other way round."""
        return turned(action * self.rates, start.yaw)

    def _state(self, own: Proprioception) -> State:
        """By kinematics; of the object nothing is known."""
        T, fingers, n = forward_kinematics(self.hand.joints, own.q), self.hand.fingers, len(own.q)
        unknown = np.full((n, 7), np.nan)
        return State(own.q, own.qd, own.torque, points_on_links(T, fingers.tip_link, fingers.tip_m), self.palm(own.q)[0], unknown,
                     unknown[:, :3], unknown[:, :3], own.press_n[..., None], np.nan, 0)  # fmt: skip


def body_of(scenery: Scenery, rates: np.ndarray) -> Body:
    """The robot of these worlds."""
    return Body(scenery.hand, scenery.palm_offset, rates)

