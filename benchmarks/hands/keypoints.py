"""Keypoints of the rendered hands: the 21 points of schemas.hand.KEYPOINTS in the world and in the picture."""

from __future__ import annotations

import numpy as np

from afford.render.scene import Camera
from afford.synthetic.human_hand.hand_model import MIRROR, HandModel
from afford.synthetic.human_hand.skeleton import LENGTHS, WRIST, bone_frames


def palm_keypoints(angles: np.ndarray) -> np.ndarray:
    """Compute the keypoints (21, 3) of a right hand in the palm frame, metres: the wrist, then the joints and tip of each digit."""
    bones = bone_frames(angles)[2:].reshape(5, 3, 4, 4)
    ends = bones[:, 2, :3, 3] + bones[:, 2, :3, 0] * LENGTHS[:, 2:3]
    return np.concatenate([WRIST[None], np.concatenate([bones[:, :, :3, 3], ends[:, None]], axis=1).reshape(20, 3)])


def world_keypoints(hand: HandModel, T_world_palm: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Compute the keypoints (21, 3) of a posed hand, world, metres."""
    T = T_world_palm @ (MIRROR if hand.side == "left" else np.eye(4))
    return np.asarray(palm_keypoints(angles) @ T[:3, :3].T + T[:3, 3])


def in_camera(points: np.ndarray, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Return world points (n, 3) as pixels (n, 2) and in the camera frame (n, 3), metres, both float32."""
    T = np.linalg.inv(camera.T_world_cam)
    local = points @ T[:3, :3].T + T[:3, 3]
    image = local @ camera.K.T
    return (image[:, :2] / np.maximum(image[:, 2:], 1e-6)).astype(np.float32), local.astype(np.float32)
