"""Actions as the paper has them: a force and a torque on the palm, targets of the fingers, 60 a second.

An action (m,) is in -1..1: a force and a torque on the palm's origin along the axes of the episode's frame (published: of the
world), then the targets of the fingers' motors from one limit of the joint to the other. Nothing is integrated. The hand has no
weight, and what moves freely is slowed down (Scene, wrist=wrench), both as published.
"""

from __future__ import annotations

import numpy as np

from afford.grasping.env.act import FREE, turned

CONTROL_S = 1 / 60
STEPS = 200
"""of an episode"""
FORCE_N, TORQUE_NM = 200.0, 1.0 / 60 * 0.1 * 1e3
"""of a full action. The torque is published (a x dt x 0.1 x 1e3). The published force, a x dt x 0.5 x 1e5 = 833 N, would move our
hand, 0.9 kg with its gantry, at 10 m/s against drag, 4 cm a step of the solver; its slides give 200 N, and 2.3 m/s"""


def table(limits: np.ndarray) -> np.ndarray:
    """(m, 2) what a full action gives each motor, N, N m or rad from the middle of its limits (m, 2); no caps."""
    full = np.concatenate([[FORCE_N] * 3, [TORQUE_NM] * 3, _middle(limits)[1]])
    return np.stack([full, np.full(len(full), FREE)], axis=1)


def command(action: np.ndarray, q_wrist: np.ndarray, yaw: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """(n, m) forces and torques of the gantry's joints at q_wrist (n, 6), and targets of fingers, of actions (n, m); yaw (n,) of
    the frame that forces and torques are meant in.
    """
    a = action.clip(-1, 1)
    force, torque = turned(FORCE_N * a[:, :3], yaw), turned(TORQUE_NM * a[:, 3:6], yaw)
    middle, half = _middle(limits)
    return np.concatenate([force, np.einsum("nki,ni->nk", hinges(q_wrist), torque), middle + half * a[:, 6:]], axis=1)


def action_for(efforts: np.ndarray, fingers: np.ndarray, q_wrist: np.ndarray, yaw: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """(n, m) the action that `command` turns into these efforts (n, 6) of the gantry and targets (n, m - 6), within -1..1."""
    torque = np.linalg.solve(hinges(q_wrist), efforts[:, 3:, None])[..., 0]
    middle, half = _middle(limits)
    parts = (turned(efforts[:, :3], -yaw) / FORCE_N, turned(torque, -yaw) / TORQUE_NM, (fingers - middle) / half)
    found: np.ndarray = np.concatenate(parts, axis=1).clip(-1, 1)
    return found


def hinges(q_wrist: np.ndarray) -> np.ndarray:
    """(n, 3, 3) axes of yaw, pitch and roll in the world, a row each; a torque on the palm works on a joint as far as it is along
    its axis, and a force on the palm's origin, through which all three go, not at all.
    """
    yaw, pitch = q_wrist[:, 3], q_wrist[:, 4]
    zero, one = np.zeros_like(yaw), np.ones_like(yaw)
    along_z = np.stack([zero, zero, one], axis=1)
    along_y = np.stack([-np.sin(yaw), np.cos(yaw), zero], axis=1)
    along_x = np.stack([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), -np.sin(pitch)], axis=1)
    return np.stack([along_z, along_y, along_x], axis=1)


def _middle(limits: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(m - 6,) middle of the fingers' limits, and half of their width."""
    low, high = limits[6:].T
    return (low + high) / 2, (high - low) / 2
