"""Numbers of a reader -> a HandMotion, after the checks that all readers share."""

from __future__ import annotations

import numpy as np

from afford.common.errors import SourceError
from schemas.hand import PHASES, HandMotion

HAND_M = (0.04, 0.16)
"""wrist to the middle finger's knuckle, from a small child to the largest adults with room to spare"""
RATE_HZ = (1.0, 1000.0)
DOCS = "see docs/grasping/motion-format.md"


def build(name: str, source: str, side: str, rate_hz: float, keypoints: np.ndarray, *, where: str, phase: np.ndarray | None = None,
          object_name: str = "", object_pose: np.ndarray | None = None, T_world_palm: np.ndarray | None = None) -> HandMotion:
    """The motion; SourceError names `where` when the numbers cannot be one of a hand in metres.

    keypoints (t, 21, 3) in the order of KEYPOINTS; phase (t,); object_pose (t, 7) with quaternions x y z w of any length but 0;
    T_world_palm (t, 4, 4). What is None is not known.
    """
    _check(side, rate_hz, keypoints, where)
    frames = len(keypoints)
    given = {"phase": (phase, (frames,)), "object_pose": (object_pose, (frames, 7)), "T_world_palm": (T_world_palm, (frames, 4, 4))}
    for field, (numbers, shape) in given.items():
        if numbers is not None and (np.shape(numbers) != shape or not np.isfinite(numbers).all()):
            raise SourceError(f"{where}, {field}", f"finite numbers {shape}, one row for each frame", f"{np.shape(numbers)}",
                              "make them as long as the keypoints, or leave them out")
    phases = np.zeros(frames, np.uint8) if phase is None else np.asarray(phase)
    if ((phases < 0) | (phases >= len(PHASES))).any():
        raise SourceError(f"{where}, phase", f"0 to {len(PHASES) - 1}: {', '.join(PHASES)}", f"{phases.max()}", DOCS)
    return HandMotion(
        name, source, side, float(rate_hz), np.array(keypoints, np.float64), phases.astype(np.uint8), object_name,
        np.zeros((0, 7)) if object_pose is None else _unit(np.array(object_pose, np.float64), where),
        np.zeros((0, 4, 4)) if T_world_palm is None else np.array(T_world_palm, np.float64))  # fmt: skip


def _check(side: str, rate_hz: float, keypoints: np.ndarray, where: str) -> None:
    if side not in ("left", "right"):
        raise SourceError(f"{where}, hand", "left or right", repr(side), DOCS)
    if not RATE_HZ[0] <= rate_hz <= RATE_HZ[1]:
        raise SourceError(f"{where}, fps", f"{RATE_HZ[0]:g} to {RATE_HZ[1]:g} frames a second", f"{rate_hz}", DOCS)
    if keypoints.ndim != 3 or keypoints.shape[1:] != (21, 3) or len(keypoints) == 0:
        raise SourceError(f"{where}, keypoints", "numbers (frames, 21, 3), one frame at least", f"{keypoints.shape}", DOCS)
    wrong = ~np.isfinite(keypoints).all(axis=(1, 2))
    if wrong.any():
        raise SourceError(f"{where}, keypoints", "finite numbers", f"one that is not in frame {int(wrong.argmax())}",
                          "cut the clip there, or fill the gap")
    length = float(np.median(np.linalg.norm(keypoints[:, 9] - keypoints[:, 0], axis=-1)))
    if not HAND_M[0] <= length <= HAND_M[1]:
        raise SourceError(f"{where}, keypoints", f"metres: {HAND_M[0]} to {HAND_M[1]} from wrist to middle knuckle",
                          f"{length:.4g}", "is the unit mm, or the order of points another one? " + DOCS)


def _unit(pose: np.ndarray, where: str) -> np.ndarray:
    length = np.linalg.norm(pose[:, 3:], axis=1, keepdims=True)
    if (length < 1e-6).any():
        raise SourceError(f"{where}, object_pose", "quaternions x y z w", f"zeros in frame {int(length.argmin())}", DOCS)
    pose[:, 3:] /= length
    return pose
