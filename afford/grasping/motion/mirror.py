"""A left hand as a right one, and back: everything is reflected in the plane x = 0."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schemas.hand import HandMotion

M = np.diag([-1.0, 1.0, 1.0])
OTHER = {"left": "right", "right": "left"}


def mirrored(motion: HandMotion) -> HandMotion:
    """The same motion of the other hand. Rotations R become M R M: the object must be mirrored in its own frame as well."""
    pose = motion.object_pose * np.array([-1, 1, 1, 1, -1, -1, 1])
    palm = motion.T_world_palm.copy()
    palm[:, :3, :3] = M @ palm[:, :3, :3] @ M
    palm[:, :3, 3] = palm[:, :3, 3] @ M
    return replace(motion, side=OTHER[motion.side], keypoints_m=motion.keypoints_m @ M, object_pose=pose, T_world_palm=palm)
