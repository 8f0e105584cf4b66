"""What a face is like: its colour, and how thick the object is behind it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from afford.render.views.surface import Rays, areas
from schemas.mesh import ObjectMesh

CONE = 7
"""rays that measure how thick the object is behind a face"""
CONE_DEG = 30.0
COLOUR_PX = 512
"""textures are read at most so fine: print is not a part"""


@dataclass(frozen=True, eq=False)
class Features:
    """Per face: `middle` (f, 3) and `normal` (f, 3) float64, `area` (f,) m^2, `colour` (f, 3) float32 CIE Lab, `thickness` (f,) m,
    median length of rays into the object.
    """

    middle: np.ndarray
    normal: np.ndarray
    area: np.ndarray
    colour: np.ndarray
    thickness: np.ndarray

    @staticmethod
    def of(mesh: ObjectMesh) -> Features:
        """Of every face."""
        corner = mesh.vertices[mesh.faces].astype(np.float64)
        area, normal = areas(corner)
        middle = corner.mean(1)
        return Features(middle, normal, area, colours(mesh), thickness(mesh, middle, normal))


def colours(mesh: ObjectMesh) -> np.ndarray:
    """(f, 3) float32 CIE Lab of the texture in the middle of each face."""
    scale = min(1.0, COLOUR_PX / max(mesh.texture.shape[:2]))
    size = tuple(max(1, round(side * scale)) for side in mesh.texture.shape[1::-1])
    small = cv2.resize(mesh.texture, size, interpolation=cv2.INTER_AREA)
    lab = cv2.cvtColor(small.astype(np.float32) / 255, cv2.COLOR_RGB2Lab)
    u, v = mesh.uv.mean(1).T % 1.0
    found = cv2.remap(lab, (u * size[0] - 0.5).astype(np.float32)[:, None], ((1 - v) * size[1] - 0.5).astype(np.float32)[:, None],
                      cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # fmt: skip
    return np.asarray(found[:, 0])


def thickness(mesh: ObjectMesh, middle: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(f,) float64 metres to the other side: median of a cone of rays inwards (shape diameter, Shapira et al. 2008)."""
    rays, size = Rays(mesh.vertices, mesh.faces), float(np.ptp(mesh.vertices, axis=0).max())
    found = np.full((CONE, len(middle)), size)
    for row, direction in zip(found, _cone(-normal), strict=True):
        face = rays.first(middle - 1e-4 * size * normal, direction)
        hit = face >= 0
        plane = (middle[face[hit]] - middle[hit]) * normal[face[hit]]
        slope = (direction[hit] * normal[face[hit]]).sum(1)
        row[hit] = np.abs(plane.sum(1) / np.where(np.abs(slope) > 1e-6, slope, 1e-6)).clip(0, size)
    return np.asarray(np.median(found, axis=0).clip(1e-4 * size))


def _cone(axis: np.ndarray) -> np.ndarray:
    """(CONE, f, 3) unit vectors around each axis (f, 3): itself, and a ring."""
    helper = np.where(np.abs(axis[:, :1]) < 0.9, [[1.0, 0, 0]], [[0, 1.0, 0]])
    right = np.cross(axis, helper)
    right /= np.maximum(np.linalg.norm(right, axis=1, keepdims=True), 1e-12)
    up = np.cross(axis, right)
    turns = np.arange(CONE - 1) * (2 * np.pi / (CONE - 1))
    tilt = np.radians(CONE_DEG)
    ring = [np.cos(tilt) * axis + np.sin(tilt) * (np.cos(t) * right + np.sin(t) * up) for t in turns]
    return np.stack([axis, *ring])
