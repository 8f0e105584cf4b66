"""Skinned hand meshes of other sources, posed by the palm frame and the joint angles of the rendered hands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from afford.synthetic.human_hand.hand_model import MIRROR
from afford.synthetic.human_hand.skeleton import REST, ROOTS, WRIST, bone_frames

BONES = 17
"""forearm, palm, three bones of each digit, as in skeleton.bone_frames"""


@dataclass(frozen=True, eq=False)
class SkinnedHand:
    """Right hand at rest in the palm frame of the rendered hands, metres."""

    vertices: np.ndarray
    faces: np.ndarray
    weights: np.ndarray
    """(v, 17) of the bones `BONES`"""
    keypoints: np.ndarray
    """(21, 3) at rest"""
    pads: np.ndarray
    """(5, 3) direction from the nail to the pad of each digit, at rest"""
    colour: np.ndarray
    """(v, 3) multiplies the skin's colour"""

    def posed(self, angles: np.ndarray, elbow: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pose by joint angles (20,) and the elbow (3,) in the right palm frame; return vertices (v, 3) and keypoints (21, 3)."""
        moves, points = np.tile(np.eye(4), (BONES, 1, 1)), self.keypoints.copy()
        arm = Rotation.align_vectors([elbow - points[0]], [[-1.0, 0, 0]])[0].as_matrix()
        moves[0, :3, :3], moves[0, :3, 3] = arm, points[0] - arm @ points[0]
        frames = bone_frames(np.asarray(angles, float))
        for digit in range(5):
            origin = self.keypoints[1 + 4 * digit]
            for link in range(3):
                k, bone = 1 + 4 * digit + link, 2 + 3 * digit + link
                turn = frames[bone, :3, :3] @ basis(self.keypoints[k + 1] - self.keypoints[k], self.pads[digit]).T
                moves[bone, :3, :3], moves[bone, :3, 3] = turn, origin - turn @ self.keypoints[k]
                points[k] = origin
                origin = origin + turn @ (self.keypoints[k + 1] - self.keypoints[k])
            points[4 + 4 * digit] = origin
        blended = np.einsum("vb,bij->vij", self.weights, moves[:, :3])
        return np.einsum("vij,vj->vi", blended[..., :3], self.vertices) + blended[..., 3], points

    def in_world(self, T_world_palm: np.ndarray, side: str, angles: np.ndarray, elbow: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pose a hand of a side in the world; the elbow is (3,) in the world. Faces of a left hand must be turned over."""
        T = T_world_palm @ (MIRROR if side == "left" else np.eye(4))
        local = np.linalg.inv(T) @ np.append(elbow, 1.0)
        vertices, points = self.posed(angles, local[:3])
        return (vertices @ T[:3, :3].T + T[:3, 3]).astype(np.float32), points @ T[:3, :3].T + T[:3, 3]


def basis(along: np.ndarray, pad: np.ndarray) -> np.ndarray:
    """Return the orthonormal frame (3, 3), in columns: along the bone, across it, towards the pad."""
    x = along / np.linalg.norm(along)
    z = pad - x * (x @ pad)
    z /= np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z], axis=1)


def rest_pads(keypoints: np.ndarray) -> np.ndarray:
    """Estimate pad directions (5, 3) of a hand at rest: those of the rendered hand, turned with the digit's direction."""
    out = []
    for digit in range(5):
        ours, along = REST[2 + 3 * digit, :3, :3], keypoints[3 + 4 * digit] - keypoints[1 + 4 * digit]
        turn = Rotation.align_vectors([along], [ours[:, 0]])[0]
        out.append(turn.apply(ours[:, 2]))
    return np.array(out)


def aligned(keypoints: np.ndarray) -> np.ndarray:
    """Compute the similarity transform (4, 4) that fits wrist and knuckles (21, 3) to those of the rendered hand."""
    theirs, ours = keypoints[[0, 5, 9, 13, 17]], np.concatenate([WRIST[None], ROOTS[1:]])
    a, b = theirs - theirs.mean(0), ours - ours.mean(0)
    u, s, vt = np.linalg.svd(b.T @ a)
    flip = np.diag([1, 1, np.sign(np.linalg.det(u @ vt))])
    scale = float((s * np.diag(flip)).sum() / (a**2).sum())
    T = np.eye(4)
    T[:3, :3] = scale * u @ flip @ vt
    T[:3, 3] = ours.mean(0) - T[:3, :3] @ theirs.mean(0)
    return T
