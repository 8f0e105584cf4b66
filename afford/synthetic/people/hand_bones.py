"""The skeleton of a right hand in its palm frame: bones, thicknesses, joint axes, and where the bones go for given angles.

Palm frame: origin at the centre of the palm's skin, x along the fingers, z out of the palm, thumb at -y. Metres, radians.
The 20 joints: thumb (oppose as a share, flex, middle, tip), then index, middle, ring, little, each (spread, knuckle, middle, tip).
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

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
