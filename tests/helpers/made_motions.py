"""Motions for tests: one that the robot hand itself makes, files of keypoints, the shared recordings."""

from __future__ import annotations

import json
import pickle
from pathlib import Path

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from afford.grasping.hand.kinematics import (
    commanded_joints,
    coupling_matrix,
    forward_kinematics,
    joint_limits,
    moving_joints,
    points_on_links,
)
from afford.grasping.motion.keypoints import hand_motion
from afford.grasping.motion.oakink2 import TIPS
from afford.grasping.motion.oakink2_import import convert_all
from afford.grasping.motion.targets import hand_points
from runner.canonical import file_digest
from schemas.files import FileRef, FileTree
from schemas.hand import GraspTarget, HandModel, HandMotion
from tests.helpers.made_hands import shadow

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data" / "motion"
HANDLE_ALONG_X = np.array([[0.0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1]])


def trajectory(hand: HandModel, frames: int, seed: int, *, share: float = 0.8) -> np.ndarray:
    """Return (t, d) sines of all motors and of the wrist within a share of their range; coupled joints follow their drivers."""
    rng = np.random.default_rng(seed)
    columns = [moving_joints(hand.joints).tolist().index(k) for k in commanded_joints(hand.joints)]
    low, high = joint_limits(hand.joints)[columns].T
    wrist = np.array([hand.joints.role[k] == "wrist" for k in commanded_joints(hand.joints)])
    near = np.where([hand.joints.kind[k] == "prismatic" for k in commanded_joints(hand.joints)], 0.3, 1.0)
    low, high = np.where(wrist, np.maximum(low, -near), low), np.where(wrist, np.minimum(high, near), high)
    wave = np.sin(np.linspace(0, 3, frames)[:, None] + rng.uniform(0, 6, len(columns)))
    A, b = coupling_matrix(hand.joints)
    found: np.ndarray = ((low + high) / 2 + share / 2 * (high - low) * wave) @ A.T + b
    return found


def own_motion(hand: HandModel, q: np.ndarray, rate_hz: float = 60.0) -> HandMotion:
    """Return the keypoints that a tracker would measure on the robot hand."""
    return hand_motion("own", "test", hand.side, rate_hz, keypoints_of(hand, forward_kinematics(hand.joints, q)), where="test")


def keypoints_of(hand: HandModel, T: np.ndarray) -> np.ndarray:
    """Return keypoints (n, 21, 3) for poses (n, l, 4, 4) of all links; NaN for fingers that the hand lacks."""
    which = hand_points(hand)
    out = np.full((len(T), 21, 3), np.nan)
    out[:, 0] = T[:, hand.palm, :3, 3]
    out[:, which.keypoint.ravel()] = points_on_links(T, which.links, which.offsets_m)
    return out


def tree(*paths: Path) -> FileTree:
    """Files of one folder."""
    return FileTree(paths[0].parent.name, tuple(FileRef(p.name, file_digest(p), p.stat().st_size, p) for p in sorted(paths)))


def rod(diameter_m: float = 0.04, handle: np.ndarray = HANDLE_ALONG_X) -> GraspTarget:
    """Build a rod along x, or along another handle."""
    return GraspTarget("rod", "rod", np.array([0.1, 0.3, 0.05, 0, 0, 0, 1.0]), handle, diameter_m)


def recorded(folder: Path) -> dict[str, FileTree]:
    """Backend -> a small source of that format, written here."""
    motion = own_motion(shadow(), trajectory(shadow(), 40, seed=1))
    mine, dexycb = folder / "own.npz", folder / "dexycb.npz"
    np.savez(mine, keypoints=motion.keypoints_m, fps=60.0, hand="right", unit="m")
    theirs = motion.keypoints_m[:2, [0, *range(5, 21), *range(1, 5)]].reshape(2, 63)
    np.savez(dexycb, **{"14/final_ee_rel": theirs})
    oakink2 = folder / "oakink2"
    convert_all(oakink2_root(folder / "root"), oakink2)
    for side in TIPS:
        np.savez(oakink2 / f"mano_{side}.npz", **pretend_mano(seed=3))
    return {"keypoints": tree(mine), "dexycb": tree(dexycb), "oakink2": tree(*oakink2.iterdir())}


def pretend_mano(seed: int) -> dict[str, np.ndarray]:
    """Arrays of MANO's shapes that are a stick figure: a joint is a vertex, a fingertip moves with the last joint of its finger."""
    rng = np.random.default_rng(seed)
    parents = np.array([0, 0, 1, 2, 0, 4, 5, 0, 7, 8, 0, 10, 11, 0, 13, 14])
    vertices = rng.normal(0, 0.01, (778, 3))
    for row, (x, start) in enumerate(zip((0.03, 0.01, -0.03, -0.01, 0.04), (0.09, 0.095, 0.08, 0.09, 0.03), strict=True)):
        for k in range(3):
            vertices[1 + 3 * row + k] = [x, 0, start + 0.03 * k]
    vertices[0] = 0
    weights = np.zeros((778, 16))
    weights[:, 0] = 1
    for tips in TIPS.values():
        for tip, last in zip(tips, (15, 3, 6, 12, 9), strict=True):
            vertices[tip] = vertices[last] + [0, 0, 0.025]
            weights[tip] = np.eye(16)[last]
    return {"v_template": vertices, "shapedirs": rng.normal(0, 0.001, (778, 3, 10)), "posedirs": np.zeros((778, 3, 135)),
            "J_regressor": np.eye(16, 778), "weights": weights, "kintree_table": np.stack([parents, np.arange(16)])}  # fmt: skip


def oakink2_root(root: Path) -> Path:
    """A sequence of 30 frames in OakInk2's format: two primitives, the first of both hands."""
    wrist = np.roll(Rotation.from_rotvec([0.3, 0.2, 0.1]).as_quat(), 1)
    pose = torch.tensor(np.concatenate([wrist[None], np.tile([1.0, 0, 0, 0], (15, 1))]))[None]
    tsl = np.linspace([0, 0, 1], [1, 0, 1], 30)
    hand = [{f"{short}__{field}": value for short in ("lh", "rh") for field, value in
             (("pose_coeffs", pose), ("tsl", torch.tensor(row)[None]), ("betas", torch.zeros(1, 10)))} for row in tsl]  # fmt: skip
    T = np.array([[0.0, -1, 0, 0.1], [1, 0, 0, 0.2], [0, 0, 1, 0.3], [0, 0, 0, 1]])
    anno = {"mocap_frame_id_list": list(range(30)), "raw_mano": dict(enumerate(hand)), "obj_list": ["cup"],
            "obj_transf": {"cup": dict.fromkeys(range(30), T)}, "cam_def": {"104422070969": "egocentric"}}  # fmt: skip
    program = {"((2, 10), (0, 10))": {"primitive_lh": None, "primitive_rh": "pour", "obj_list_lh": None, "obj_list_rh": ["jug"]},
               "(None, (10, 30))": {"primitive_lh": None, "primitive_rh": "place", "obj_list_lh": [], "obj_list_rh": ["cup"]}}
    (root / "anno_preview").mkdir(parents=True)
    (root / "program" / "program_info").mkdir(parents=True)
    (root / "anno_preview" / "scene_01++seq_a.pkl").write_bytes(pickle.dumps(anno))
    (root / "program" / "program_info" / "scene_01++seq_a.json").write_text(json.dumps(program))
    return root
