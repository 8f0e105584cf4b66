"""What the hand does before a policy adds to it: nothing, or the grasp by script. Both begin open, 12 cm above the aim.

The base `prior` does nothing by itself either: the frozen prior acts, as a policy. The hand begins in the posture that it knows.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from afford.grasping.env.act import turned
from afford.grasping.hand.kinematics import commanded_columns, coupling_matrix
from afford.grasping.sim.scene import Scene
from afford.grasping.sim.scripted import CLOSE, DESCEND, GRASP, HOLD, LIFT, LIFT_M, Aim, grasp_commands, start_joints

BASES = ("none", "script", "prior")


def begin(scene: Scene, aim: Aim, posture: Sequence[float] = ()) -> np.ndarray:
    """(d,) joints at the beginning: as the script begins, or in a posture (m,) of the motors, whose wrist is meant from the aim."""
    if not posture:
        return start_joints(scene, aim, GRASP)
    A, b = coupling_matrix(scene.hand.joints)
    return A @ from_aim(np.asarray(posture, np.float64)[None], np.array([aim.yaw]), aim.place[None])[0] + b


def from_aim(u: np.ndarray, yaw: np.ndarray, place: np.ndarray) -> np.ndarray:
    """(n, m) motors whose wrist is meant from places (n, 3), along axes turned by yaw (n,) -> as the gantry has them."""
    out = turned(u, yaw)
    out[:, :3] += place
    out[:, 3] += yaw
    return out


def commands(base: str, scene: Scene, aim: Aim, steps: int, lift_m: float, posture: Sequence[float] = (),
             wait: int = 0) -> np.ndarray:  # fmt: skip
    """(steps, m) targets, step by step; the script ends by holding. ValueError for an unknown base, or too few steps for it."""
    if base in ("none", "prior"):
        u = begin(scene, aim, posture)[commanded_columns(scene.hand.joints)]
        return np.tile(u, (steps, 1))
    if base != "script":
        raise ValueError(f"base: expected {' or '.join(BASES)}, got {base!r}")
    return scripted(scene, aim, steps, lift_m, wait)


def script_steps(lift_m: float) -> int:
    """Control steps of the script: it lifts no faster when it lifts higher."""
    return DESCEND + CLOSE + _lift_steps(lift_m) + HOLD


def scripted(scene: Scene, aim: Aim, steps: int, lift_m: float, wait: int = 0) -> np.ndarray:
    """(steps, m) targets of the script, lifting by lift_m after `wait` steps above; ValueError when that takes more steps."""
    least = wait + script_steps(lift_m)
    if steps < least:
        raise ValueError(f"steps: expected {least} or more for a grasp by script that lifts {lift_m:g} m, got {steps}")
    above = begin(scene, aim)[commanded_columns(scene.hand.joints)]
    closed = np.array([*[above] * wait, *grasp_commands(scene, aim, GRASP)])[: wait + DESCEND + CLOSE]
    s = (np.arange(1, steps - len(closed) + 1) / _lift_steps(lift_m)).clip(max=1.0)
    lifted = np.repeat(closed[-1:], len(s), axis=0)
    lifted[:, 2] += lift_m * s * s * (3 - 2 * s)
    return np.concatenate([closed, lifted])


def _lift_steps(lift_m: float) -> int:
    return max(1, round(LIFT * lift_m / LIFT_M))
