"""Actions as rates: every number of an action moves the target of one motor a little; what has been moved is an offset.

An action (m,) is in -1..1: the wrist's x, y, z along the axes of the episode's frame (scenery.py), its yaw, pitch and roll, then
the motors of the fingers in the order of the hand (18 in the Shadow Hand: m = 24). Offsets are integrated, so that exploration is
smooth, and stay within the caps and the limits of the joints. A command is what the base (base.py) wants plus the offset.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Rates:
    """How far a full action moves a target in one control step, and how far offsets may go; inf where only joints' limits hold."""

    along_m: tuple[float, float]
    """(per step, cap) of x: along the part to hold"""
    across_m: tuple[float, float]
    up_m: tuple[float, float]
    yaw_rad: tuple[float, float]
    tilt_rad: tuple[float, float]
    """pitch and roll"""
    finger_rad: tuple[float, float]


FREE = float("inf")
RATES = {
    "none": Rates((0.03, FREE), (0.03, FREE), (0.03, FREE), (0.12, FREE), (0.12, FREE), (0.25, FREE)),
    "prior": Rates((0.03, FREE), (0.03, FREE), (0.03, FREE), (0.06, FREE), (0.06, FREE), (0.15, FREE)),
    "script": Rates((0.015, 0.12), (0.008, 0.04), (0.008, 0.04), (0.05, 0.5), (0.03, 0.25), (0.08, 0.6)),
}
"""by base: alone, a policy must do everything; as people do it, at their speeds; over the script it may only correct"""


def checked(action: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """The actions as float64; ValueError for another shape than (n, m), or for numbers that are not finite."""
    out = np.asarray(action, np.float64)
    if out.shape != shape or not np.isfinite(out).all():
        raise ValueError(f"action: expected finite {shape}, got shape {out.shape}"
                         f"{'' if np.isfinite(out).all() else ' with numbers that are not finite'}")
    return out


def table(rates: Rates, motors: int) -> np.ndarray:
    """(m, 2) rate and cap of each motor."""
    wrist = (rates.along_m, rates.across_m, rates.up_m, rates.yaw_rad, rates.tilt_rad, rates.tilt_rad)
    return np.array([*wrist, *[rates.finger_rad] * (motors - len(wrist))])


def moved(rates: np.ndarray, offset: np.ndarray, action: np.ndarray) -> np.ndarray:
    """(n, m) offsets after an action (n, m); what is beyond -1..1 is cut off."""
    return (offset + action.clip(-1, 1) * rates[:, 0]).clip(-rates[:, 1], rates[:, 1])


def command(base: np.ndarray, offset: np.ndarray, yaw: np.ndarray, limits: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Targets u (n, m) within the limits (m, 2), and the offsets that they amount to: nothing winds up beyond a limit.

    `base` (n, m) and `yaw` (n,) of the frame that the offset's x and y are meant in.
    """
    u = (base + turned(offset, yaw)).clip(*limits.T)
    return u, turned(u - base, -yaw)


def towards(rates: np.ndarray, before: np.ndarray, after: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """(n, m) the action that leads from targets (n, m) to others, as far as one step goes."""
    found: np.ndarray = (turned(after - before, -yaw) / rates[:, 0]).clip(-1, 1)
    return found


def turned(offset: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """(n, m) with x and y turned about the vertical by yaw (n,)."""
    out = offset.copy()
    c, s = np.cos(yaw), np.sin(yaw)
    out[:, 0], out[:, 1] = c * offset[:, 0] - s * offset[:, 1], s * offset[:, 0] + c * offset[:, 1]
    return out
