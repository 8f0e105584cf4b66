"""Skeleton of a right hand: bones, radii, joint limits, forward kinematics, named postures and finger closing.

Palm frame: origin at the centre of the palm's skin, x along the fingers, z out of the palm, thumb at -y. Metres, radians. The
20 joints are those of the thumb (opposition 0..1, flexion, middle, tip), then of index, middle, ring and little finger (spread,
knuckle, middle, tip).
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
"""Directions of the thumb and of its pad, beside the palm (opposition 0) and in front of it (opposition 1)."""
LOW = np.array([-0.3, -0.35, -0.2, -0.3] + [-0.30, -0.25, 0.0, 0.0] * 4)
HIGH = np.array([1.3, 0.9, 0.9, 1.2] + [0.30, 1.55, 1.75, 1.25] * 4)


def _basis(along: np.ndarray, pad: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis (3, 3), in columns: along the digit, across it, towards the pad."""
    x = along / np.linalg.norm(along)
    z = pad - x * (x @ pad)
    z /= np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _turn_z(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _flex(angle: float) -> np.ndarray:
    """Return the rotation that turns x (along) towards z (pad)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])


def _oppose(share: float) -> np.ndarray:
    """Interpolate the thumb frame between beside the palm (0) and in front of it (1)."""
    return _ASIDE @ Rotation.from_rotvec(share * _SWING).as_matrix()


_ASIDE = _basis(*np.array(_THUMB_ASIDE))
_SWING = Rotation.from_matrix(_ASIDE.T @ _basis(*np.array(_THUMB_OPPOSED))).as_rotvec()
BASES = np.stack([_ASIDE] + [_turn_z(a) for a in SPLAY[1:]])


def bone_frames(angles: np.ndarray) -> np.ndarray:
    """Compute T_palm_bone (17, 4, 4): forearm (identity, see `HandModel`), palm, then three bones of each digit.

    The origin of a bone is its proximal joint, x points along it and z towards the pad.
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
    """Return the centres (5, 3) of the fingertips, palm frame, metres."""
    frames = bone_frames(angles)[4::3]
    return frames[:, :3, 3] + frames[:, :3, 0] * LENGTHS[:, 2:3]


def link_points(angles: np.ndarray, per_link: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """Sample points on the axes of all links: points (5, 3, per_link, 3) in the palm frame, radii (5, 3, per_link) in metres."""
    frames = bone_frames(angles)[2:].reshape(5, 3, 4, 4)
    s = (np.arange(per_link) + 1.0) / per_link
    along = LENGTHS[:, :, None] * s
    points = frames[:, :, None, :3, 3] + along[..., None] * frames[:, :, None, :3, 0]
    return points, RADII[:, :3, None] * (1 - s) + RADII[:, 1:, None] * s


Distance = Callable[[np.ndarray], np.ndarray]
"""Signed distance function: (n, 3) points in the right-hand palm frame -> (n,) metres, negative inside the object."""

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
"""Number of surface points that vote on whether a point is inside."""
SINK_M = 0.0012
"""Depth by which a link may press into the object, metres."""


def posture(kind: str, aperture_m: float = 0.06) -> np.ndarray:
    """Return the joint angles (20,) of a named posture, or of a grasp type closed on a cylinder of thickness `aperture_m`."""
    if kind in POSTURES:
        return np.array(POSTURES[kind])
    centre = {"pinch": (0.075, 0.0, 0.045), "flat_edge": (0.07, 0.0, 0.03)}.get(kind, (0.012, 0.0, aperture_m / 2))

    def cylinder(p: np.ndarray) -> np.ndarray:
        return np.hypot(p[:, 0] - centre[0], p[:, 2] - centre[2]) - aperture_m / 2

    return close_on(kind, cylinder)


def opening_posture(kind: str) -> np.ndarray:
    """Return the joint angles (20,) of the open hand that approaches for a grasp type."""
    return np.array(OPENING[kind])


def close_on(kind: str, distance: Distance, steps: int = STEPS) -> np.ndarray:
    """Close the fingers on an object and return the joint angles (20,).

    From the opening posture of `kind`, each joint bends in `steps` until a link beyond it touches the object. A joint stops
    when it would press a link deeper than `SINK_M`. Joints beyond it continue, so the fingers wrap around the object.
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
    """Return the penetration depth (5, 3) of each link into the object, metres, negative when it is away."""
    points, radius = link_points(angles)
    gap = distance(points.reshape(-1, 3)).reshape(radius.shape) - radius
    return -gap.min(axis=2)


def distance_to(mesh: Mesh, T_palm_mesh: np.ndarray, side: str, *, samples: int = 6000, seed: int = 0) -> Distance:
    """Build the signed distance function of a mesh in the right-hand palm frame from points on its surface.

    A left hand is mirrored.
    """
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
