"""Gauss-Newton fit of a hand's metric keypoints to their image: known bone lengths, a stiff palm, bones near given directions."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

CHAINS = ((0, 1, 2, 3, 4), (0, 5, 6, 7, 8), (0, 9, 10, 11, 12), (0, 13, 14, 15, 16), (0, 17, 18, 19, 20))
"""keypoints of each finger from the wrist, thumb first"""
BONES = np.array([[0.197, 0.200, 0.185, 0.158], [0.462, 0.245, 0.143, 0.097], [0.446, 0.266, 0.170, 0.108],
                  [0.421, 0.244, 0.165, 0.107], [0.410, 0.204, 0.117, 0.093]])  # fmt: skip
"""lengths of the bones of each chain as shares of the hand's length: phalanges after Buchholz, Armstrong and Goldstein 1992,
knuckles and thumb as keypoint trackers place them"""
ACROSS, ACROSS_M = ((5, 9), (9, 13), (13, 17), (5, 17)), np.array([0.110, 0.104, 0.092, 0.302])
"""pairs of knuckles, and their distances as shares of the hand's length"""
EDGES = np.array([*(pair for chain in CHAINS for pair in pairwise(chain)), *ACROSS])
LENGTHS = np.concatenate([BONES.ravel(), ACROSS_M])
BONE_COUNT = BONES.size
IMAGE, DIRECTION, BONE, PALM_WIDTH = 0.02, 0.6, 0.02, 0.15
"""standard deviations: of keypoints in the image, as a share of the hand's length there; of bones from their given vectors, of the
lengths of bones and of the distances of knuckles, as shares of their lengths"""
STEPS = 6
DAMPING = 1e-6


def fit_to_image(placed: np.ndarray, rays: np.ndarray, weight: np.ndarray, hand_m: float) -> np.ndarray:
    """Fit keypoints (t, 21, 3), in metres and in the camera frame, to image points.

    rays: (t, 21, 2), image points at depth 1. weight: (t, 21), 1 for reliable image points, 0 for unknown ones. Bones stay near
    the vectors that they have in `placed`.
    """
    frames, fitted = len(placed), placed
    wanted = placed[:, EDGES[:BONE_COUNT, 1]] - placed[:, EDGES[:BONE_COUNT, 0]]
    lengths = hand_m * LENGTHS
    spread = lengths * np.where(np.arange(len(LENGTHS)) < BONE_COUNT, BONE, PALM_WIDTH)
    seen, bend = _image_rows(rays), _bone_rows()
    for _ in range(STEPS):
        image = np.einsum("tkcp,tp->tkc", seen, fitted.reshape(frames, -1)) / (IMAGE * hand_m)
        bones = fitted[:, EDGES[:, 1]] - fitted[:, EDGES[:, 0]]
        found = np.linalg.norm(bones, axis=-1)
        along = np.einsum("tec,ecp->tep", bones / np.maximum(found, 1e-9)[..., None], bend) / spread[:, None]
        apart = (bones[:, :BONE_COUNT] - wanted) / (DIRECTION * lengths[:BONE_COUNT, None])
        root = np.sqrt(weight)[..., None]
        rows = np.concatenate([
            (seen * root[..., None] / (IMAGE * hand_m)).reshape(frames, -1, 63), along,
            np.broadcast_to((bend[:BONE_COUNT] / (DIRECTION * lengths[:BONE_COUNT, None, None])).reshape(-1, 63),
                            (frames, 3 * BONE_COUNT, 63))], axis=1)  # fmt: skip
        residuals = np.concatenate([(image * root).reshape(frames, -1), (found - lengths) / spread, apart.reshape(frames, -1)],
                                   axis=1)  # fmt: skip
        normal = rows.transpose(0, 2, 1) @ rows + DAMPING * np.eye(63)
        step = np.linalg.solve(normal, np.einsum("trp,tr->tp", rows, residuals)[..., None])[..., 0]
        fitted = fitted - step.reshape(frames, 21, 3)
    return fitted


def _image_rows(rays: np.ndarray) -> np.ndarray:
    """Return the derivatives (t, 21, 2, 63) of the offsets of keypoints from their rays, x - u z and y - v z."""
    rows = np.zeros((len(rays), 21, 2, 21, 3))
    for point in range(21):
        for axis in range(2):
            rows[:, point, axis, point, axis] = 1
            rows[:, point, axis, point, 2] = -rays[:, point, axis]
    return rows.reshape(len(rays), 21, 2, 63)


def _bone_rows() -> np.ndarray:
    """Return the derivatives (e, 3, 63) of the vectors along the edges."""
    rows = np.zeros((len(EDGES), 3, 21, 3))
    for edge, (start, end) in enumerate(EDGES):
        for axis in range(3):
            rows[edge, axis, end, axis], rows[edge, axis, start, axis] = 1, -1
    return rows.reshape(len(EDGES), 3, 63)
