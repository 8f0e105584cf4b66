"""Skin of the right hand: mesh of a signed distance field of tapered bones, with skinning weights for each bone."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from skimage.measure import marching_cubes

from afford.synthetic.human_hand.skeleton import LENGTHS, RADII, REST, ROOTS, WRIST

ARM_M = 0.42
STEP_M = 0.0032
BLEND_M = 0.0045
"""Distance over which the skin blends between two neighbouring bones, metres."""


@dataclass(frozen=True, eq=False)
class HandShape:
    """Skin mesh: vertices (v, 3) at rest in the palm frame, faces (f, 3), weights (v, 17), digit (v,) with -1 for palm and arm."""

    vertices: np.ndarray
    faces: np.ndarray
    weights: np.ndarray
    digit: np.ndarray


def _cone(p: np.ndarray, a: np.ndarray, b: np.ndarray, ra: float, rb: float) -> np.ndarray:
    """Return the distance to a tapered capsule from a to b."""
    ab = b - a
    s = np.clip((p - a) @ ab / (ab @ ab), 0, 1)
    return np.linalg.norm(p - a - s[..., None] * ab, axis=-1) - (ra + (rb - ra) * s)


def _ball(p: np.ndarray, centre: tuple[float, ...], radii: tuple[float, ...]) -> np.ndarray:
    """Return the approximate distance to an ellipsoid."""
    q = (p - np.asarray(centre)) / np.asarray(radii)
    k = np.linalg.norm(q, axis=-1)
    return (k - 1) * min(radii)


def _join(a: np.ndarray, b: np.ndarray, width: float) -> np.ndarray:
    """Return the smooth union of two distance fields (polynomial)."""
    h = np.clip(0.5 + 0.5 * (b - a) / width, 0, 1)
    return b + (a - b) * h - width * h * (1 - h)


def digit_field(p: np.ndarray, digit: int) -> np.ndarray:
    """Return the signed distance to one digit at rest, with a pad under its tip."""
    out = np.zeros(0)
    for link in range(3):
        T = REST[2 + 3 * digit + link]
        end = T[:3, 3] + T[:3, 0] * LENGTHS[digit, link]
        part = _cone(p, T[:3, 3], end, RADII[digit, link], RADII[digit, link + 1])
        out = _join(out, part, 0.003) if link else part
    pad = T[:3, 3] + T[:3, 0] * LENGTHS[digit, 2] * 0.55 + T[:3, 2] * 0.0018
    return _join(out, np.linalg.norm(p - pad, axis=-1) - RADII[digit, 2] * 0.92, 0.003)


def palm_field(p: np.ndarray) -> np.ndarray:
    """Return the signed distance to palm, wrist and forearm at rest."""
    base = WRIST + np.array([[0.012, -0.016, 0], [0.010, -0.006, -0.001], [0.010, 0.006, -0.001], [0.012, 0.016, 0.001]])
    out = _arm_field(p)
    for k in range(4):
        out = _join(out, _cone(p, base[k], ROOTS[k + 1], 0.0150, 0.0122), 0.010)
    out = _join(out, _ball(p, (-0.022, -0.021, -0.004), (0.030, 0.017, 0.0135)), 0.010)
    out = _join(out, _ball(p, (-0.018, 0.027, -0.007), (0.033, 0.0135, 0.0125)), 0.010)
    web = REST[2, :3, 3] + REST[2, :3, 0] * 0.034
    out = _join(out, _cone(p, web, ROOTS[1] + np.array([-0.012, 0.004, 0.002]), 0.0070, 0.0085), 0.014)
    return _join(out, _cone(p, ROOTS[0], web, 0.0165, 0.0125), 0.008)


def _arm_field(p: np.ndarray) -> np.ndarray:
    """Return the signed distance to a flattened forearm that extends back from the wrist."""
    back = WRIST[0] - p[..., 0]
    thick = np.interp(back, [-0.02, 0.02, 0.10, 0.22, 0.42], [0.0180, 0.0185, 0.0240, 0.0330, 0.0380])
    wide = np.interp(back, [-0.02, 0.02, 0.10, 0.22, 0.42], [0.0270, 0.0270, 0.0310, 0.0400, 0.0440])
    ring = np.hypot((p[..., 1] - WRIST[1]) / wide, (p[..., 2] - WRIST[2]) / thick)
    return np.maximum((ring - 1) * thick, -back - 0.012)


def _nodes() -> list[np.ndarray]:
    """Return the grid lines of the field: fine around the hand, coarse along the arm."""
    fine = np.arange(-0.115, 0.152, STEP_M)
    coarse = np.arange(WRIST[0] - ARM_M, -0.115, 0.009)
    return [np.concatenate([coarse, fine]), np.arange(-0.100, 0.066, STEP_M), np.arange(-0.062, 0.058, STEP_M)]


@lru_cache(maxsize=1)
def hand_shape() -> HandShape:
    """Build the skin of the right hand, once per process."""
    nodes = _nodes()
    p = np.stack(np.meshgrid(*nodes, indexing="ij"), axis=-1)
    palm = palm_field(p)
    field = palm
    for digit in range(5):
        field = np.minimum(field, _join(palm, digit_field(p, digit), 0.008 if digit else 0.010))
    index, faces, _, _ = marching_cubes(field, 0.0)
    vertices = np.stack([np.interp(index[:, k], np.arange(len(nodes[k])), nodes[k]) for k in range(3)], axis=1)
    owner = _digit_of(vertices)
    return HandShape(vertices.astype(np.float32), faces[:, ::-1].astype(np.int32), _weights(vertices, owner), owner)


def _digit_of(vertices: np.ndarray) -> np.ndarray:
    fields = np.stack([palm_field(vertices)] + [digit_field(vertices, k) for k in range(5)])
    return np.argmin(fields, axis=0) - 1


def _weights(vertices: np.ndarray, digit: np.ndarray) -> np.ndarray:
    """Compute the skinning weights (v, 17) float32.

    A vertex follows the palm and its nearest digit only, so that fingers do not drag one another.
    """
    fields = np.stack([digit_field(vertices, k) for k in range(5)])
    nearest = np.where(digit >= 0, digit, np.argmin(fields, axis=0))
    out = np.zeros((len(vertices), 17))
    back = WRIST[0] - vertices[:, 0]
    out[:, 0] = 1 / (1 + np.exp(-(back - 0.002) / 0.006))
    out[:, 1] = (1 - out[:, 0]) * np.exp(-np.maximum(palm_field(vertices), 0) / BLEND_M)
    for k in range(5):
        mine = nearest == k
        for link in range(3):
            T = REST[2 + 3 * k + link]
            end = T[:3, 3] + T[:3, 0] * LENGTHS[k, link]
            gap = _cone(vertices[mine], T[:3, 3], end, RADII[k, link], RADII[k, link + 1])
            out[mine, 2 + 3 * k + link] = np.exp(-np.maximum(gap, 0) / BLEND_M) * _ahead(vertices[mine], T)
    out[:, 2:] *= (1 - out[:, :1]) * np.where(palm_field(vertices) < -1e-3, 0.15, 1.0)[:, None]
    return (out / out.sum(axis=1, keepdims=True)).astype(np.float32)


def _ahead(points: np.ndarray, T: np.ndarray) -> np.ndarray:
    """Return a smooth step 0..1 across the proximal joint of a bone, over the blending distance."""
    along = (points - T[:3, 3]) @ T[:3, 0]
    return 1 / (1 + np.exp(-along / (0.5 * BLEND_M)))
