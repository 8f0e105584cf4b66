"""The skeleton of a right hand in its palm frame: bones, thicknesses, joint axes, and where the bones go for given angles.

Palm frame: origin at the centre of the palm's skin, x along the fingers, z out of the palm, thumb at -y. Metres, radians.
The 20 joints: thumb (oppose as a share, flex, middle, tip), then index, middle, ring, little, each (spread, knuckle, middle, tip).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from afford.render.mesh import Mesh

DIGITS = ("thumb", "index", "middle", "ring", "little")
FOREARM, PALM = 0, 1
WRIST = np.array([-0.056, 0.0, -0.016])
ROOTS = np.array(
    [
        [-0.034, -0.021, -0.008],
        [0.040, -0.028, -0.0145],
        [0.043, -0.0055, -0.016],
        [0.038, 0.0165, -0.015],
        [0.029, 0.0365, -0.012],
    ]
)
LENGTHS = np.array(
    [[0.044, 0.034, 0.024], [0.044, 0.026, 0.017], [0.048, 0.030, 0.018], [0.044, 0.028, 0.018], [0.034, 0.021, 0.016]]
)
RADII = np.array(
    [
        [0.0155, 0.0118, 0.0106, 0.0090],
        [0.0107, 0.0094, 0.0083, 0.0072],
        [0.0109, 0.0096, 0.0085, 0.0074],
        [0.0102, 0.0090, 0.0080, 0.0070],
        [0.0091, 0.0079, 0.0070, 0.0062],
    ]
)
SPLAY = np.radians([0.0, -5.0, -1.0, 3.0, 9.0])
_THUMB_ASIDE = ((0.66, -0.60, 0.45), (0.25, 0.75, 0.62))
_THUMB_OPPOSED = ((0.28, -0.30, 0.91), (0.86, 0.40, -0.15))
"""Direction of the thumb and of its pad, beside the palm (oppose = 0) and in front of it (oppose = 1)."""
LOW = np.array([-0.3, -0.35, -0.2, -0.3] + [-0.30, -0.25, 0.0, 0.0] * 4)
HIGH = np.array([1.3, 0.9, 0.9, 1.2] + [0.30, 1.55, 1.75, 1.25] * 4)


def _basis(along: np.ndarray, pad: np.ndarray) -> np.ndarray:
    """(3, 3) columns: along the digit, across, towards the pad side."""
    x = along / np.linalg.norm(along)
    z = pad - x * (x @ pad)
    z /= np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _turn_z(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _flex(angle: float) -> np.ndarray:
    """Rotation that turns x (along) towards z (pad)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])


def _oppose(share: float) -> np.ndarray:
    """Thumb frame on the way from beside the palm (0) to in front of it (1), pad turning to the fingers."""
    return _ASIDE @ Rotation.from_rotvec(share * _SWING).as_matrix()


_ASIDE = _basis(*np.array(_THUMB_ASIDE))
_SWING = Rotation.from_matrix(_ASIDE.T @ _basis(*np.array(_THUMB_OPPOSED))).as_rotvec()
BASES = np.stack([_ASIDE] + [_turn_z(a) for a in SPLAY[1:]])


def bone_frames(angles: np.ndarray) -> np.ndarray:
    """(17, 4, 4) T_palm_bone: forearm (identity: see `HandModel`), palm, then three bones of each digit.

    A bone's origin is its near joint, x along it, z towards the pad.
    """
    out = np.tile(np.eye(4), (17, 1, 1))
    for digit in range(5):
        first, second, third, fourth = angles[4 * digit : 4 * digit + 4]
        R = _oppose(first) @ _flex(second) if digit == 0 else BASES[digit] @ _turn_z(first) @ _flex(second)
        origin = ROOTS[digit]
        for link, bend in enumerate((0.0, third, fourth)):
            R = R @ _flex(bend) if link else R
            T = out[2 + 3 * digit + link]
            T[:3, :3], T[:3, 3] = R, origin
            origin = origin + R[:, 0] * LENGTHS[digit, link]
    return out


REST = bone_frames(np.zeros(20))


def tips(angles: np.ndarray) -> np.ndarray:
    """(5, 3) centres of the fingertips, palm frame, metres."""
    frames = bone_frames(angles)[4::3]
    return frames[:, :3, 3] + frames[:, :3, 0] * LENGTHS[:, 2:3]


def link_points(angles: np.ndarray, per_link: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """Points on the axes of all links, (5, 3, per_link, 3) palm frame, and the thickness there, (5, 3, per_link) metres."""
    frames = bone_frames(angles)[2:].reshape(5, 3, 4, 4)
    s = (np.arange(per_link) + 1.0) / per_link
    along = LENGTHS[:, :, None] * s
    points = frames[:, :, None, :3, 3] + along[..., None] * frames[:, :, None, :3, 0]
    return points, RADII[:, :3, None] * (1 - s) + RADII[:, 1:, None] * s


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


def opening_posture(kind: str) -> np.ndarray:
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
