"""Actions of the hand: rates of the motors' targets over a base, or wrenches on the palm (the published form).

An action (m,) is in -1..1: six numbers of the wrist, then the motors of the fingers in the order of the hand (18 in the Shadow
Hand: m = 24). The wrist's numbers are along the axes of the episode's frame (scenery.py).

Rates (action_mode=rate, 20 actions per second): every number moves the target of one motor a little: x, y, z of the wrist, its
yaw, pitch and roll, the fingers. The sum of these moves is an offset. Offsets are integrated, so that exploration is smooth, and
stay within caps and joint limits. A command is the target of the base plus the offset. The base does nothing (none, prior) or
follows the scripted grasp (script). With the base prior, the frozen prior acts as a policy, and the hand begins in the posture it
was trained with.

Wrenches (action_mode=paper, 60 actions per second): a force and a torque on the palm's origin (published: along the axes of the
world), then the targets of the fingers' motors from one joint limit to the other. Nothing is integrated. The hand has no weight,
and free motion is damped (Scene, wrist=wrench), both as published.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from afford.common.arrays import copied, namespace
from afford.grasping.hand.kinematics import commanded_columns, coupling_matrix
from afford.grasping.sim.scene import Scene
from afford.grasping.sim.scripted import CLOSE, DESCEND, GRASP, HOLD, LIFT, LIFT_M, Aim, grasp_commands, start_joints

FREE = float("inf")
"""cap of an offset that only joint limits bound"""


@dataclass(frozen=True)
class Rates:
    """(rate, cap) of each kind of motor: move of a target by a full action in one control step, and largest offset."""

    along_m: tuple[float, float]
    """x of the wrist: along the part to hold"""
    across_m: tuple[float, float]
    up_m: tuple[float, float]
    yaw_rad: tuple[float, float]
    tilt_rad: tuple[float, float]
    """pitch and roll"""
    finger_rad: tuple[float, float]


RATES = {
    "none": Rates((0.03, FREE), (0.03, FREE), (0.03, FREE), (0.12, FREE), (0.12, FREE), (0.25, FREE)),
    "prior": Rates((0.03, FREE), (0.03, FREE), (0.03, FREE), (0.06, FREE), (0.06, FREE), (0.15, FREE)),
    "script": Rates((0.015, 0.12), (0.008, 0.04), (0.008, 0.04), (0.05, 0.5), (0.03, 0.25), (0.08, 0.6)),
}
"""rates by base: without a base the policy does everything; prior has the speeds of people; over the script it only corrects"""


def checked(action: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Actions as float64. ValueError for another shape than (n, m), or numbers that are not finite."""
    out = np.asarray(action, np.float64)
    if out.shape != shape or not np.isfinite(out).all():
        raise ValueError(f"action: expected finite {shape}, got shape {out.shape}"
                         f"{'' if np.isfinite(out).all() else ' with numbers that are not finite'}")
    return out


def rate_table(rates: Rates, motors: int) -> np.ndarray:
    """(m, 2) rate and cap of each motor."""
    wrist = (rates.along_m, rates.across_m, rates.up_m, rates.yaw_rad, rates.tilt_rad, rates.tilt_rad)
    return np.array([*wrist, *[rates.finger_rad] * (motors - len(wrist))])


def moved(rates: np.ndarray, offset: np.ndarray, action: np.ndarray) -> np.ndarray:
    """(n, m) offsets after an action (n, m), which is clipped to -1..1."""
    return (offset + action.clip(-1, 1) * rates[:, 0]).clip(-rates[:, 1], rates[:, 1])


def rate_command(base: np.ndarray, offset: np.ndarray, yaw: np.ndarray, limits: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute targets u (n, m) within the limits (m, 2), and the offsets that remain: no offset winds up beyond a limit.

    `base` (n, m) are the targets of the base, `yaw` (n,) the frames of the offsets' x and y.
    """
    u = (base + turned(offset, yaw)).clip(*limits.T)
    return u, turned(u - base, -yaw)


def towards(rates: np.ndarray, before: np.ndarray, after: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """(n, m) action that moves targets (n, m) as far towards others (n, m) as one step allows."""
    found: np.ndarray = (turned(after - before, -yaw) / rates[:, 0]).clip(-1, 1)
    return found


def turned(offset: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """(n, m) with x and y rotated about the vertical by yaw (n,)."""
    xp, out = namespace(offset), copied(offset)
    c, s = xp.cos(yaw), xp.sin(yaw)
    out[:, 0], out[:, 1] = c * offset[:, 0] - s * offset[:, 1], s * offset[:, 0] + c * offset[:, 1]
    return out


WRENCH_CONTROL_S = 1 / 60
FORCE_N, TORQUE_NM = 200.0, 1.0 / 60 * 0.1 * 1e3
"""force and torque of a full action. The torque is published (a x dt x 0.1 x 1e3). The published force, a x dt x 0.5 x 1e5 = 833 N,
would move this hand, 0.9 kg with its gantry, at 10 m/s against drag, 4 cm in a step of the solver. Its slides give 200 N and 2.3
m/s"""


def wrench_table(limits: np.ndarray) -> np.ndarray:
    """(m, 2) effect of a full action on each motor, N, N m or rad from the middle of its limits (m, 2); without caps."""
    full = np.concatenate([[FORCE_N] * 3, [TORQUE_NM] * 3, _middle(limits)[1]])
    return np.stack([full, np.full(len(full), FREE)], axis=1)


def wrench_command(action: np.ndarray, q_wrist: np.ndarray, yaw: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """(n, m) efforts of the gantry's joints at q_wrist (n, 6) and targets of the fingers, from actions (n, m).

    `yaw` (n,) is that of the frame of forces and torques.
    """
    xp, a = namespace(action), action.clip(-1, 1)
    force, torque = turned(FORCE_N * a[:, :3], yaw), turned(TORQUE_NM * a[:, 3:6], yaw)
    middle, half = _middle(limits)
    found: np.ndarray = xp.concatenate([force, xp.einsum("nki,ni->nk", hinges(q_wrist), torque), middle + half * a[:, 6:]], axis=1)
    return found


def hinges(q_wrist: np.ndarray) -> np.ndarray:
    """(n, 3, 3) axes of yaw, pitch and roll in the world, one per row.

    A torque on the palm acts on a joint by its component along the joint's axis. A force on the palm's origin, which all three axes
    pass through, does not act on them.
    """
    xp, yaw, pitch = namespace(q_wrist), q_wrist[:, 3], q_wrist[:, 4]
    zero, one = xp.zeros_like(yaw), xp.ones_like(yaw)
    along_z = xp.stack([zero, zero, one], axis=1)
    along_y = xp.stack([-xp.sin(yaw), xp.cos(yaw), zero], axis=1)
    along_x = xp.stack([xp.cos(yaw) * xp.cos(pitch), xp.sin(yaw) * xp.cos(pitch), -xp.sin(pitch)], axis=1)
    found: np.ndarray = xp.stack([along_z, along_y, along_x], axis=1)
    return found


def _middle(limits: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(m - 6,) middle of the fingers' limits, and half of their width."""
    low, high = limits[6:].T
    return (low + high) / 2, (high - low) / 2


BASES = ("none", "script", "prior")


def initial_joints(scene: Scene, aim: Aim, posture: Sequence[float] = ()) -> np.ndarray:
    """(d,) joints at the start: open, 12 cm above the aim, or in a posture (m,) of motors, its wrist relative to the aim."""
    if not posture:
        return start_joints(scene, aim, GRASP)
    A, b = coupling_matrix(scene.hand.joints)
    u = turned(np.asarray(posture, np.float64)[None], np.array([aim.yaw]))[0]
    u[:3] += aim.place
    u[3] += aim.yaw
    return A @ u + b


def base_targets(base: str, scene: Scene, aim: Aim, steps: int, lift_m: float, posture: Sequence[float] = (),
                 wait: int = 0) -> np.ndarray:  # fmt: skip
    """(steps, m) targets of a base; the script ends by holding. ValueError for an unknown base, or too few steps for the script."""
    if base in ("none", "prior"):
        u = initial_joints(scene, aim, posture)[commanded_columns(scene.hand.joints)]
        return np.tile(u, (steps, 1))
    if base != "script":
        raise ValueError(f"base: expected {' or '.join(BASES)}, got {base!r}")
    return scripted(scene, aim, steps, lift_m, wait)


def script_steps(lift_m: float) -> int:
    """Control steps of the scripted grasp; a higher lift takes longer, at the same speed."""
    return DESCEND + CLOSE + _lift_steps(lift_m) + HOLD


def scripted(scene: Scene, aim: Aim, steps: int, lift_m: float, wait: int = 0) -> np.ndarray:
    """(steps, m) targets of the scripted grasp, which waits above, then lifts by lift_m. ValueError when that takes more steps."""
    least = wait + script_steps(lift_m)
    if steps < least:
        raise ValueError(f"steps: expected {least} or more for a grasp by script that lifts {lift_m:g} m, got {steps}")
    above = initial_joints(scene, aim)[commanded_columns(scene.hand.joints)]
    closed = np.array([*[above] * wait, *grasp_commands(scene, aim, GRASP)])[: wait + DESCEND + CLOSE]
    s = (np.arange(1, steps - len(closed) + 1) / _lift_steps(lift_m)).clip(max=1.0)
    lifted = np.repeat(closed[-1:], len(s), axis=0)
    lifted[:, 2] += lift_m * s * s * (3 - 2 * s)
    return np.concatenate([closed, lifted])


def _lift_steps(lift_m: float) -> int:
    return max(1, round(LIFT * lift_m / LIFT_M))
