"""The motion of the background: cameras that map a plane of the scene to the pixels of every frame."""

from __future__ import annotations

import cv2
import numpy as np

MAX_CORNERS = 400
RANSAC_PX = 2.0


def background_cameras(grey: np.ndarray, frame: np.ndarray, static: np.ndarray) -> np.ndarray:
    """(t, 3, 4) cameras for `afford.layers.gather`; scene points are pixels of the first frame.

    grey: (t, h, w) uint8; frame: (t,) frame numbers; static: (t, h, w) bool, pixels that belong to the background. A frame
    that cannot be registered to the one before repeats its camera.
    """
    cameras = np.zeros((len(grey), 3, 4))
    motion = np.eye(3)
    cameras[:1, :, :3] = motion
    for t in range(1, len(grey)):
        step = _step(grey[t - 1], grey[t], static[t - 1], static[t])
        motion = step @ motion
        motion /= motion[2, 2]
        cameras[t, :, :3] = motion
    return cameras


def _step(before: np.ndarray, after: np.ndarray, static_before: np.ndarray, static_after: np.ndarray) -> np.ndarray:
    """Homography (3, 3) from one frame to the next; identity when too few corners are found again."""
    corners = cv2.goodFeaturesToTrack(before, MAX_CORNERS, 0.005, 6, mask=static_before.astype(np.uint8) * 255)
    if corners is None or len(corners) < 8:
        return np.eye(3)
    there, ok, _ = cv2.calcOpticalFlowPyrLK(before, after, corners, None, winSize=(15, 15), maxLevel=3)
    back, ok_back, _ = cv2.calcOpticalFlowPyrLK(after, before, there, None, winSize=(15, 15), maxLevel=3)
    good = (ok.ravel() > 0) & (ok_back.ravel() > 0) & (np.abs(back - corners).max(axis=(1, 2)) < 0.7)
    if good.sum() < 8:
        return np.eye(3)
    found, _ = cv2.findHomography(corners[good], there[good], cv2.RANSAC, RANSAC_PX)
    return np.eye(3) if found is None else found
