"""Interface of one physics world, for every engine. Units: metres, seconds, newtons; poses are (7,): x y z, quaternion x y z w.

q (d,) and qd (d,) are the joints of the hand that move, in the order of its table. A command u (m,) is a target for each joint
that has a motor, wrist first (hand/kinematics.py); with wrist=wrench, the wrist takes forces and torques. The table top is z = 0;
the base of the gantry is at the origin.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from afford.common.registry import load
from afford.grasping.sim.scene import Scene

CONTROL_S = 0.05
"""control step: 20 commands a second"""
BACKENDS = {
    "mujoco": "afford.grasping.sim.mujoco_world:MujocoWorld",
    "bullet": "afford.grasping.sim.bullet_world:BulletWorld",
}


@dataclass(frozen=True, eq=False)
class State:
    """State of a world after a step; all arrays are copies."""

    q: np.ndarray
    """(d,) rad, m"""
    qd: np.ndarray
    """(d,) rad/s, m/s"""
    torque: np.ndarray
    """(m,) of the motors, N m, or N for prismatic joints"""
    tips: np.ndarray
    """(f, 3) fingertips, thumb first"""
    palm: np.ndarray
    """(7,) pose of the palm's link"""
    body: np.ndarray
    """(7,) pose of the object's frame"""
    velocity: np.ndarray
    """(3,) of the object's centre of mass, m/s"""
    spin: np.ndarray
    """(3,) angular velocity of the object, rad/s, in world axes"""
    force: np.ndarray
    """(f + 1, p) newtons of each finger, and last of the rest of the hand, on each part"""
    penetration_m: float
    """of the deepest contact between hand and object, 0 when none"""
    contacts: int
    """number of contact points between hand and object"""


class DivergedError(RuntimeError):
    """Error of a world whose physics diverged; `reset` makes the world usable again."""


class World(Protocol):
    """World of one hand, one object and one table."""

    def reset(self, q: np.ndarray, body: np.ndarray) -> State:
        """Set the joints to q (d,) and the object's frame to the pose (7,), at rest, and cancel pushes."""

    def step(self, u: np.ndarray, control_s: float) -> State:
        """Advance by control_s, a whole number of solver steps, while the motors follow targets u (m,).

        DivergedError where an engine finds that its physics diverged.
        """

    def push(self, force: np.ndarray, duration_s: float) -> None:
        """Apply a force (3,) to the object's centre of mass for duration_s, from now on."""

    def state(self) -> State:
        """Return the current state."""

    def save(self) -> Any:
        """Return a token of all that the next step depends on."""

    def restore(self, token: Any) -> State:
        """Restore a token of this world; simulation then continues with the same bits."""

    def close(self) -> None:
        """Release the engine; closing twice is allowed."""


def make_world(engine: str, scene: Scene) -> World:
    """Create a world of an engine; ValueError lists the engines."""
    create: Callable[[Scene], World] = load(BACKENDS, engine)
    return create(scene)


def check_stage_engine(engine: str) -> None:
    """Raise ValueError for an engine of an extra, whose version is only in the keys of stages that train."""
    if engine not in BACKENDS:
        raise ValueError(f"engine: expected {' or '.join(BACKENDS)}, got {engine!r}; only environments and trainings may use other "
                         "engines")


def solver_steps(control_s: float, rate_hz: int) -> int:
    """Return the number of solver steps in a control step; ValueError when it is not a whole number above zero."""
    count = round(control_s * rate_hz)
    if count < 1 or abs(count - control_s * rate_hz) > 1e-6:
        raise ValueError(f"control_s: expected a multiple of 1/{rate_hz} s, got {control_s}")
    return count


def finite_vector(name: str, found: np.ndarray, size: int) -> np.ndarray:
    """Return (size,) finite float64; ValueError otherwise."""
    out = np.asarray(found, np.float64)
    if out.shape != (size,):
        raise ValueError(f"{name}: expected {size} numbers, got shape {out.shape}")
    if not np.isfinite(out).all():
        raise ValueError(f"{name}: expected finite numbers, got {out}")
    return out
