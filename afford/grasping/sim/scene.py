"""Description of a world: a hand on its gantry, an object, a table at z = 0, and all parameters of physics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from afford.grasping.hand.kinematics import ancestry, command_limits, commanded_columns, commanded_joints
from schemas.grasp import GraspObject
from schemas.hand import HandModel


@dataclass(frozen=True)
class Physics:
    """Parameters of physics and of its solver."""

    rate_hz: int = 240
    """solver steps a second"""
    iterations: int = 50
    """of the solver in each step: PyBullet always runs them all, MuJoCo stops at convergence"""
    gravity_m_s2: float = 9.81
    hand_friction: float = 1.0
    """Coulomb coefficient between hand and object"""
    table_friction: float = 0.7
    """between object and table"""
    spin_friction_m: float = 0.003
    """torque about a contact normal per newton: a soft fingertip touches with a patch"""
    mass_scale: float = 1.0
    """factor of the object's mass and inertia"""
    effort_scale: float = 1.0
    """factor of the torques of the fingers' motors"""
    response_s: float = 0.02
    """time constant with which a motor approaches its target, as far as its torque allows"""
    drag_1_s: float = 100.0
    """with wrist=wrench, rate at which the free hand loses speed; as published for Isaac Gym"""


STRICT = Physics(rate_hz=480, iterations=100)
"""physics of evaluation"""


@dataclass(frozen=True, eq=False)
class Scene:
    """Description of one world."""

    hand: HandModel
    body: GraspObject
    physics: Physics = field(default_factory=Physics)
    wrist: str = "servo"
    """meaning of commands to the gantry: servo, a target; wrench, a force or torque, and the hand is weightless"""

    def __post_init__(self) -> None:
        steps = {f.name: getattr(self.physics, f.name) for f in fields(Physics)}
        wrong = [name for name, number in steps.items() if not (np.isfinite(number) and number >= 0)]
        zero = [name for name in ("rate_hz", "iterations", "mass_scale", "effort_scale", "response_s") if steps[name] == 0]
        if wrong or zero:
            name = (wrong or zero)[0]
            raise ValueError(f"Physics.{name}: expected a number {'of 0 or more' if wrong else 'above 0'}, got {steps[name]}")
        if self.wrist not in ("servo", "wrench"):
            raise ValueError(f"Scene.wrist: expected servo or wrench, got {self.wrist!r}")
        wrist = self.hand.joints.role.count("wrist")
        if wrist != 6:
            raise ValueError(f"{self.hand.name}: expected a gantry of 6 joints, got {wrist}; build the hand with wrist=gantry")


def hold_command(scene: Scene, q: np.ndarray) -> np.ndarray:
    """Return the (m,) command that holds the hand at q (d,): targets, and no force on a wrist that takes forces."""
    u: np.ndarray = q[commanded_columns(scene.hand.joints)]
    return np.concatenate([np.zeros(6), u[6:]]) if scene.wrist == "wrench" else u


def scene_limits(scene: Scene) -> np.ndarray:
    """Return the (m, 2) limits of each command: rad or m; N or N m for a wrist that takes forces."""
    limits = command_limits(scene.hand.joints)
    if scene.wrist == "wrench":
        effort = scene.hand.joints.effort[commanded_joints(scene.hand.joints)[:6]]
        limits = np.concatenate([np.stack([-effort, effort], axis=1), limits[6:]])
    return limits


@dataclass(frozen=True)
class Range:
    """Distribution of one parameter in domain randomization."""

    low: float
    high: float
    spread: str = "uniform"
    """uniform, or log: uniform in the logarithm, for scales"""

    def draw(self, rng: np.random.Generator) -> float:
        """Draw one value; ValueError for an unknown distribution."""
        if self.spread == "uniform":
            return float(rng.uniform(self.low, self.high))
        if self.spread == "log":
            return float(np.exp(rng.uniform(np.log(self.low), np.log(self.high))))
        raise ValueError(f"Range.spread: expected uniform or log, got {self.spread!r}")


DOMAIN_RANDOMIZATION: Mapping[str, Range] = {
    "hand_friction": Range(0.7, 1.2),
    "table_friction": Range(0.4, 1.0),
    "spin_friction_m": Range(0.001, 0.005),
    "mass_scale": Range(0.5, 2.0, "log"),
    "effort_scale": Range(0.8, 1.25, "log"),
    "response_s": Range(0.015, 0.04, "log"),
}
"""field of Physics -> its distribution"""


@dataclass(frozen=True)
class Sensing:
    """Effects between a world and a policy; the environment applies them, not the engine."""

    latency_steps: int = 0
    """control steps by which commands are delayed"""


def centre(body: GraspObject, pose: np.ndarray) -> np.ndarray:
    """Return the (3,) centre of mass of an object whose frame is at the pose (7,)."""
    found: np.ndarray = Rotation.from_quat(pose[3:]).apply(np.array(body.com_m)) + pose[:3]
    return found


def finger_of_link(hand: HandModel) -> np.ndarray:
    """Return the (l,) finger index of each link; the number of fingers for the palm and the links above it."""
    descends = ancestry(hand.joints)
    out = np.full(len(hand.links), len(hand.fingers.name))
    beyond = descends[:, hand.palm] & (np.arange(len(out)) != hand.palm)
    for finger, tip in enumerate(hand.fingers.tip_link):
        out[descends[tip] & beyond] = finger
    return out


def randomize_physics(scene: Scene, seed: int, ranges: Mapping[str, Range] = DOMAIN_RANDOMIZATION) -> Scene:
    """Draw the physics of a scene (domain randomization); the same seed gives the same scene.

    ValueError for a name that Physics lacks.
    """
    known = {f.name for f in fields(Physics)}
    if unknown := sorted(set(ranges) - known):
        raise ValueError(f"randomised: expected fields of Physics ({', '.join(sorted(known))}), got {', '.join(unknown)}")
    rng = np.random.default_rng(seed)
    drawn: dict[str, Any] = {name: ranges[name].draw(rng) for name in sorted(ranges)}
    return replace(scene, physics=replace(scene.physics, **drawn))


def sensing(seed: int, latency_steps: int = 1) -> Sensing:
    """Draw a latency of 0 to `latency_steps` from a separate random stream."""
    return Sensing(int(np.random.default_rng([seed, 1]).integers(latency_steps + 1)))
