"""Postures of a hand, and closing the fingers on an object until they touch it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial import cKDTree

from afford.render.mesh import Mesh
from afford.synthetic.people.hand_bones import HIGH, link_points

Distance = Callable[[np.ndarray], np.ndarray]
"""(n, 3) points in the right-hand palm frame -> (n,) signed distance to the object, metres, negative inside."""

POSTURES = {
    "open": (0.2, 0.0, 0.0, 0.0) + (0.0, 0.12, 0.15, 0.10) * 4,
    "relaxed": (0.45, 0.15, 0.15, 0.2) + (0.0, 0.35, 0.55, 0.30) * 4,
    "flat": (0.05, -0.1, 0.0, 0.0) + (0.0, 0.02, 0.04, 0.02) * 4,
    "point": (0.8, 0.5, 0.4, 0.5) + (0.0, 0.15, 0.15, 0.1) + (0.0, 1.1, 1.4, 0.8) * 3,
    "fist": (0.8, 0.7, 0.5, 0.7) + (0.0, 1.35, 1.6, 1.0) * 4,
}
OPENING = {
    "power_wrap": (0.95, -0.55, -0.15, -0.2) + (0.0, -0.1, 0.05, 0.03) * 4,
    "handle_wrap": (0.85, -0.35, 0.0, 0.0) + (0.0, 0.3, 0.25, 0.15) * 4,
    "top_grab": (1.0, -0.45, -0.1, 0.0) + (0.0, 0.1, 0.1, 0.1) * 4,
    "pinch": (0.9, -0.1, 0.0, 0.0) + (0.0, 0.25, 0.25, 0.1) + (0.0, 0.28, 0.3, 0.15) + (0.0, 0.4, 0.5, 0.3) * 2,
    "flat_edge": (0.75, -0.4, 0.0, 0.0) + (0.0, 0.1, 0.05, 0.05) * 4,
}
CLOSED = {
    "power_wrap": (1.0, 0.75, 0.7, 0.9) + (0.0, 1.4, 1.5, 1.0) * 4,
    "handle_wrap": (1.0, 0.8, 0.8, 1.0) + (0.0, 1.5, 1.7, 1.2) * 4,
    "top_grab": (1.1, 0.7, 0.5, 0.6) + (0.0, 1.1, 0.9, 0.5) * 4,
    "pinch": (1.0, 0.6, 0.5, 0.6) + (0.0, 1.1, 0.9, 0.35) + (0.0, 1.1, 1.0, 0.45) + (0.0, 0.9, 1.1, 0.6) * 2,
    "flat_edge": (0.9, 0.6, 0.5, 0.5) + (0.0, 1.0, 0.6, 0.3) * 4,
}
STEPS = 36
VOTES = 8
"""Surface points that vote on whether a point is inside."""
SINK_M = 0.0012
"""How far the flesh gives way."""


def posture(kind: str, aperture_m: float = 0.06) -> np.ndarray:
    """(20,) joint angles: a named posture, or a grasp type closed on a plain cylinder `aperture_m` thick."""
    if kind in POSTURES:
        return np.array(POSTURES[kind])
    centre = {"pinch": (0.075, 0.0, 0.045), "flat_edge": (0.07, 0.0, 0.03)}.get(kind, (0.012, 0.0, aperture_m / 2))

    def cylinder(p: np.ndarray) -> np.ndarray:
        return np.hypot(p[:, 0] - centre[0], p[:, 2] - centre[2]) - aperture_m / 2

    return close_on(kind, cylinder)


def opening(kind: str) -> np.ndarray:
    """(20,) joint angles with which the hand comes near before this grasp."""
    return np.array(OPENING[kind])


def close_on(kind: str, distance: Distance, steps: int = STEPS) -> np.ndarray:
    """(20,) joint angles: from the opening of `kind`, every joint bends until a link beyond it touches the object, in `steps`.

    A joint stops when it would press a link deeper than the flesh gives way; joints beyond it go on, so fingers wrap.
    """
    angles, goal = np.array(OPENING[kind]), np.array(CLOSED[kind])
    stride = (goal - angles) / steps
    before = link_depths(angles, distance)
    for _ in range(steps):
        for joint in range(4):
            trial = angles.copy()
            trial[joint::4] = np.minimum(trial[joint::4] + stride[joint::4], HIGH[joint::4])
            depth = link_depths(trial, distance)
            pressed = (depth > np.maximum(before, SINK_M)).any(axis=1)
            angles[joint::4] = np.where(pressed, angles[joint::4], trial[joint::4])
            before = np.where(pressed[:, None], before, depth)
    return angles


def link_depths(angles: np.ndarray, distance: Distance) -> np.ndarray:
    """(5, 3) how deep each link is in the object, metres, negative when it is away."""
    points, radius = link_points(angles)
    gap = distance(points.reshape(-1, 3)).reshape(radius.shape) - radius
    return -gap.min(axis=2)


def distance_to(mesh: Mesh, T_palm_mesh: np.ndarray, side: str, *, samples: int = 6000, seed: int = 0) -> Distance:
    """Distance function of a mesh in the right-hand palm frame (a left hand is mirrored), from points on its surface."""
    rng = np.random.default_rng(seed)
    tri = mesh.vertices[mesh.faces].astype(float)
    normal = np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0])
    area = np.linalg.norm(normal, axis=1)
    face = rng.choice(len(tri), samples, p=area / area.sum())
    s, t = rng.random((2, samples, 1))
    s, t = np.where(s + t > 1, 1 - s, s), np.where(s + t > 1, 1 - t, t)
    T = (np.diag([1.0, -1.0, 1.0, 1.0]) if side == "left" else np.eye(4)) @ T_palm_mesh
    points = (tri[face, 0] + s * (tri[face, 1] - tri[face, 0]) + t * (tri[face, 2] - tri[face, 0])) @ T[:3, :3].T + T[:3, 3]
    outward = (normal[face] / area[face, None]) @ T[:3, :3].T
    tree = cKDTree(points)

    def distance(p: np.ndarray) -> np.ndarray:
        gap, index = tree.query(p, k=VOTES)
        votes = ((p[:, None] - points[index]) * outward[index]).sum(axis=(1, 2))
        return np.where(votes >= 0, gap[:, 0], -gap[:, 0])

    return distance
