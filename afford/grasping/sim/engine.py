"""One world, whichever engine computes it. Metres, seconds, newtons; poses are (7,): x y z, then quaternion x y z w.

q (d,) and qd (d,) are the joints of the hand that move, in the order of its table; a command u (m,) is a target for each joint that
has a motor, wrist first (hand/coupling.py); for the wrist a force or torque where the scene says wrist=wrench. Table top is
z = 0; the gantry's base stands at the origin.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from afford.common.registry import load
from afford.grasping.sim.scene import Scene

CONTROL_S = 0.05
"""a control step: 20 commands a second"""
BACKENDS = {
    "mujoco": "afford.grasping.sim.mujoco_world:MujocoWorld",
    "bullet": "afford.grasping.sim.bullet_world:BulletWorld",
}


@dataclass(frozen=True, eq=False)
class State:
    """What is known of a world after a step. Everything is a copy."""

    q: np.ndarray
    """(d,) rad, m"""
    qd: np.ndarray
    """(d,) rad/s, m/s"""
    torque: np.ndarray
    """(m,) of the motors, N m (N where a joint slides)"""
    tips: np.ndarray
    """(f, 3) fingertips, thumb first"""
    palm: np.ndarray
    """(7,) pose of the palm's link"""
    body: np.ndarray
    """(7,) pose of the object's frame"""
    velocity: np.ndarray
    """(3,) of the object's centre of mass, m/s"""
    spin: np.ndarray
    """(3,) of the object, rad/s, along the axes of the world"""
    force: np.ndarray
    """(f + 1, p) newtons that each finger, and last the rest of the hand, press on each part with"""
    penetration_m: float
    """of the deepest contact between hand and object, 0 when none"""
    contacts: int
    """points where hand and object touch"""


class World(Protocol):
    """One hand, one object, one table."""

    def reset(self, q: np.ndarray, body: np.ndarray) -> State:
        """Put the joints at q (d,) and the object's frame at the pose (7,), at rest; forget pushes."""

    def step(self, u: np.ndarray, control_s: float) -> State:
        """Let the motors follow targets u (m,) for a time, a whole number of solver steps."""

    def push(self, force: np.ndarray, duration_s: float) -> None:
        """From now on, and for a time, a force (3,) acts on the object's centre of mass."""

    def state(self) -> State:
        """What is known now."""

    def save(self) -> Any:
        """Everything that the next step depends on."""

    def restore(self, token: Any) -> State:
        """Back to what was saved in this world: it goes on as it did then, to the bit."""

    def close(self) -> None:
        """Give the engine back; closing twice is harmless."""


def make_world(engine: str, scene: Scene) -> World:
    """A world of this engine; ValueError lists the engines."""
    made: Callable[[Scene], World] = load(BACKENDS, engine)
    return made(scene)


def check_stage_engine(engine: str) -> None:
    """ValueError for an engine that stages must not compute with: those of extras, whose versions are in no key."""
    if engine not in BACKENDS:
        raise ValueError(f"engine: expected {' or '.join(BACKENDS)}, got {engine!r}; environments may have others, stages may not")


def solver_steps(control_s: float, rate_hz: int) -> int:
    """How many solver steps make a control step; ValueError when it is not a whole number above zero."""
    count = round(control_s * rate_hz)
    if count < 1 or abs(count - control_s * rate_hz) > 1e-6:
        raise ValueError(f"control_s: expected a multiple of 1/{rate_hz} s, got {control_s}")
    return count


def finite_vector(name: str, found: np.ndarray, size: int) -> np.ndarray:
    """(size,) float64, finite; ValueError otherwise."""
    out = np.asarray(found, np.float64)
    if out.shape != (size,):
        raise ValueError(f"{name}: expected {size} numbers, got shape {out.shape}")
    if not np.isfinite(out).all():
        raise ValueError(f"{name}: expected finite numbers, got {out}")
    return out
