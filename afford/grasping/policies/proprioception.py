"""Proprioception of n robots: joints, motors, touch, commands and the place of the start, without anything of the object.

The frame of the start has its origin on the table below the middle of the palm; x points along the fingers, seen from above.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from afford.grasping.env.actions import turned
from afford.grasping.env.measures import Measures
from afford.grasping.env.obs_blocks import LAYOUTS, Snapshot, observe
from afford.grasping.env.scenery import EpisodeFrame, Scenery, palm_yaw, to_world
from afford.grasping.hand.kinematics import forward_kinematics, points_on_links
from afford.grasping.sim.engine import State
from schemas.hand import HandModel


@dataclass(frozen=True, eq=False)
class StartFrame:
    """Frames of n hands at the start of their episodes."""

    origin: np.ndarray
    """(n, 3) m, world: below the middle of the palm, on the table"""
    yaw: np.ndarray
    """(n,) yaw of the fingers, seen from above"""


@dataclass(frozen=True, eq=False)
class Proprioception:
    """Readings of the sensors and commands of n robots."""

    q: np.ndarray
    """(n, d) joint positions"""
    qd: np.ndarray
    """(n, d) joint speeds"""
    torque: np.ndarray
    """(n, m) torques of the motors"""
    press_n: np.ndarray
    """(n, f + 1) N on each finger, and last on the rest of the hand"""
    offset: np.ndarray
    """(n, m) offsets of the targets by actions so far, m or rad, along the axes of the world"""
    action: np.ndarray
    """(n, m) move of the targets by the last action, m or rad, along the axes of the world"""
    lag: np.ndarray
    """(n, m) from joints to their targets, in full actions"""
    phase: np.ndarray
    """(n,) share of the episode that has passed"""


def sense(now: Snapshot, rates: np.ndarray) -> Proprioception:
    """Read the robots' own sensors and commands; `rates` (m,) of a full action. Sensors do not tell which part is touched."""
    state, yaw = now.state, now.episode.yaw
    return Proprioception(state.q, state.qd, state.torque, state.force.sum(axis=2), turned(now.offset * rates, yaw),
                          turned(now.action * rates, yaw), now.lag, now.phase)  # fmt: skip


@dataclass(frozen=True, eq=False)
class RobotBody:
    """Robot hand, and the moves of a full action."""

    hand: HandModel
    palm_offset: np.ndarray
    """(3,) middle of the palm, in its frame"""
    rates: np.ndarray
    """(m,) move of each target by a full action, m or rad"""

    def palm(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(n, d) joints -> pose of the palm (n, 7), its middle (n, 3)."""
        T = forward_kinematics(self.hand.joints, q)[:, self.hand.palm]
        pose = np.concatenate([T[:, :3, 3], Rotation.from_matrix(T[:, :3, :3]).as_quat()], axis=1)
        return pose, to_world(pose, np.tile(self.palm_offset, (len(q), 1, 1)))[:, 0]

    def start(self, own: Proprioception) -> StartFrame:
        """Frames of the start of hands that begin now."""
        return StartFrame(self.palm(own.q)[1] * (1, 1, 0), palm_yaw(self.hand, self._state(own)))

    def numbers(self, layout: str, own: Proprioception, start: StartFrame) -> np.ndarray:
        """(n, r) float32 observation blocks R of a layout (obs_blocks.py), in the frame of the start.

        Every quantity of an object is NaN here, so that a block that reads one shows it.
        """
        state = self._state(own)
        nothing = np.full((len(own.q), 1, 3), np.nan)
        known: dict[str, Any] = {"hand": self.hand, "palm_offset": self.palm_offset}
        scenery = Scenery(**({f.name: nothing for f in fields(Scenery)} | known))
        measures = Measures(**{f.name: nothing for f in fields(Measures)})
        episode = EpisodeFrame(start.origin, start.yaw, nothing[:, 0])
        now = Snapshot(scenery, episode, state, measures, self.to_start(own.action, start), self.to_start(own.offset, start),
                       own.lag, own.phase)  # fmt: skip
        return observe(LAYOUTS[layout]["R"], now)

    def to_start(self, moved: np.ndarray, start: StartFrame) -> np.ndarray:
        """(n, m) moves along the axes of the world -> in full actions along those of the start."""
        found: np.ndarray = turned(moved, -start.yaw) / self.rates
        return found

    def to_world(self, action: np.ndarray, start: StartFrame) -> np.ndarray:
        """(n, m) full actions along the axes of the start -> moves along those of the world."""
        return turned(action * self.rates, start.yaw)

    def _state(self, own: Proprioception) -> State:
        """State by forward kinematics; everything of the object is NaN."""
        T, fingers, n = forward_kinematics(self.hand.joints, own.q), self.hand.fingers, len(own.q)
        unknown = np.full((n, 7), np.nan)
        return State(own.q, own.qd, own.torque, points_on_links(T, fingers.tip_link, fingers.tip_m), self.palm(own.q)[0], unknown,
                     unknown[:, :3], unknown[:, :3], own.press_n[..., None], np.nan, 0)  # fmt: skip


def robot_body(scenery: Scenery, rates: np.ndarray) -> RobotBody:
    """Robot of the worlds of a scenery."""
    return RobotBody(scenery.hand, scenery.palm_offset, rates)

