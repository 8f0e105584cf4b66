"""Where a clip lies in the world: turned and shifted about z, which changes nothing for gravity."""

from __future__ import annotations

import numpy as np

from schemas.hand import HandMotion


def placed(motion: HandMotion, palm: np.ndarray) -> np.ndarray:
    """(4, 4) T_world_source: the gantry's yaw is 0 on average, so that it stays far from its limits, and the object of the first
    frame, or the palm where there is none, is at x = y = 0. palm (t, 4, 4) in the source's world.
    """
    toward = palm[:, :2, 0].mean(axis=0)
    yaw = np.arctan2(toward[1], toward[0]) if np.linalg.norm(toward) > 1e-6 else 0.0
    c, s = np.cos(yaw), np.sin(yaw)
    T = np.eye(4)
    T[:2, :2] = [[c, s], [-s, c]]
    start = motion.object_pose[0, :3] if len(motion.object_pose) else palm[0, :3, 3]
    T[:2, 3] = -(T[:2, :2] @ start[:2])
    return T
