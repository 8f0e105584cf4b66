"""Motions for tests: one that the robot hand itself makes, files of keypoints, the shared recordings."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from afford.hands.coupling import driven, spread
from afford.hands.kinematics import forward, limits, moving
from afford.motion.build import build
from afford.motion.points import keypoints_of
from runner.canonical import file_digest
from schemas.files import FileRef, FileTree
from schemas.hand import HandModel
from schemas.motion import GraspTarget, HandMotion
from tests.made_hands import shadow

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data" / "motion"
HANDLE_ALONG_X = np.array([[0.0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1]])


def trajectory(hand: HandModel, frames: int, seed: int, *, share: float = 0.8) -> np.ndarray:
    """(t, d) sines of all motors and of the wrist within that share of their range, coupled joints with their drivers."""
    rng = np.random.default_rng(seed)
    columns = [moving(hand.joints).tolist().index(k) for k in driven(hand.joints)]
    low, high = limits(hand.joints)[columns].T
    wrist = np.array([hand.joints.role[k] == "wrist" for k in driven(hand.joints)])
    near = np.where([hand.joints.kind[k] == "prismatic" for k in driven(hand.joints)], 0.3, 1.0)
    low, high = np.where(wrist, np.maximum(low, -near), low), np.where(wrist, np.minimum(high, near), high)
    wave = np.sin(np.linspace(0, 3, frames)[:, None] + rng.uniform(0, 6, len(columns)))
    A, b = spread(hand.joints)
    found: np.ndarray = ((low + high) / 2 + share / 2 * (high - low) * wave) @ A.T + b
    return found


def own_motion(hand: HandModel, q: np.ndarray, rate_hz: float = 60.0) -> HandMotion:
    """What a tracker would see of the robot hand."""
    return build("own", "test", hand.side, rate_hz, keypoints_of(hand, forward(hand.joints, q)), where="test")


def tree(*paths: Path) -> FileTree:
    """Files of one folder."""
    return FileTree(paths[0].parent.name, tuple(FileRef(p.name, file_digest(p), p.stat().st_size, p) for p in sorted(paths)))


def rod(diameter_m: float = 0.04, handle: np.ndarray = HANDLE_ALONG_X) -> GraspTarget:
    """A rod that lies along x unless told otherwise."""
    return GraspTarget("rod", "rod", np.array([0.1, 0.3, 0.05, 0, 0, 0, 1.0]), handle, diameter_m)


def recorded(folder: Path) -> dict[str, FileTree]:
    """Backend -> a small source of that format, written here."""
    motion = own_motion(shadow(), trajectory(shadow(), 40, seed=1))
    mine, dexycb = folder / "own.npz", folder / "dexycb.npz"
    np.savez(mine, keypoints=motion.keypoints_m, fps=60.0, hand="right", unit="m")
    theirs = motion.keypoints_m[:2, [0, *range(5, 21), *range(1, 5)]].reshape(2, 63)
    np.savez(dexycb, **{"14/final_ee_rel": theirs})
    return {"keypoints": tree(mine), "dexycb": tree(dexycb)}
