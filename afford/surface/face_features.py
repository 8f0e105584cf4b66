"""What a face is like: its colour, and how thick the object is behind it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from afford.render.views.surface import Rays, face_areas
from schemas.mesh import ObjectMesh

CONE = 7
"""rays that measure how thick the object is behind a face"""
CONE_DEG = 30.0
COLOUR_PX = 512
"""textures are read at most so fine: print is not a part"""


@dataclass(frozen=True, eq=False)
class FaceFeatures:
    """Per face: `middle` (f, 3) and `normal` (f, 3) float64, `area` (f,) m^2, `colour` (f, 3) float32 CIE Lab, `thickness` (f,) m,
    median length of rays into the object.
    """

    middle: np.ndarray
    normal: np.ndarray
    area: np.ndarray
    colour: np.ndarray
    thickness: np.ndarray

    @staticmethod
    def of(mesh: ObjectMesh) -> FaceFeatures:
        """Of every face."""
        corner = mesh.vertices[mesh.faces].astype(np.float64)
        area, normal = face_areas(corner)
        middle = corner.mean(1)
        return FaceFeatures(middle, normal, area, face_colours(mesh), shape_diameter(mesh, middle, normal))


def face_colours(mesh: ObjectMesh) -> np.ndarray:
    """(f, 3) float32 CIE Lab of the texture in the middle of each face."""
    scale = min(1.0, COLOUR_PX / max(mesh.texture.shape[:2]))
    size = tuple(max(1, round(side * scale)) for side in mesh.texture.shape[1::-1])
    small = cv2.resize(mesh.texture, size, interpolation=cv2.INTER_AREA)
    lab = cv2.cvtColor(small.astype(np.float32) / 255, cv2.COLOR_RGB2Lab)
    u, v = mesh.uv.mean(1).T % 1.0
    found = cv2.remap(lab, (u * size[0] - 0.5).astype(np.float32)[:, None], ((1 - v) * size[1] - 0.5).astype(np.float32)[:, None],
                      cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # fmt: skip
    return np.asarray(found[:, 0])


def shape_diameter(mesh: ObjectMesh, middle: np.ndarray, normal: np.ndarray) -> np.ndarray:
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


MERGE = 1e-6
"""corners nearer than this share of the object's size are one place"""


@dataclass(frozen=True)
class BorderWeights:
    """What counts how much."""

    concave: float = 1.0
    """an angle inwards, a radian: parts meet in creases (minima rule, Hoffman and Richards 1984)"""
    convex: float = 0.15
    """an angle outwards, a radian"""
    colour: float = 0.02
    """a unit of CIE Lab"""
    thickness: float = 0.5
    """thickness changed by a factor e"""


@dataclass(frozen=True, eq=False)
class Borders:
    """(e, 2) int32 pairs of faces that share an edge, its length (e,) m and its strength (e,)."""

    pair: np.ndarray
    length: np.ndarray
    strength: np.ndarray

    @staticmethod
    def of(vertices: np.ndarray, faces: np.ndarray, features: FaceFeatures, weights: BorderWeights) -> Borders:
        """Of every pair of faces that share an edge; corners at one place are one."""
        pair, length = shared_edges(vertices, faces)
        a, b = pair.T
        bend = np.arccos((features.normal[a] * features.normal[b]).sum(1).clip(-1, 1))
        inwards = ((features.middle[b] - features.middle[a]) * features.normal[a]).sum(1) > 0
        tint = np.linalg.norm(features.colour[a] - features.colour[b], axis=1)
        thick = np.abs(np.log(features.thickness[a] / features.thickness[b]))
        strength = bend * np.where(inwards, weights.concave, weights.convex) + weights.colour * tint + weights.thickness * thick
        return Borders(pair, length, strength)


def shared_edges(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(e, 2) int32 faces on both sides of each edge, and its length (e,). Corners at one place are one, so that seams of the
    texture do not part what lies together; where more than two faces share an edge they are paired in their order.
    """
    size = float(np.ptp(vertices, axis=0).max())
    place = np.unique(np.round(vertices / max(size * MERGE, 1e-30)), axis=0, return_inverse=True)[1].reshape(-1)[faces]
    sides = ((0, 1), (1, 2), (2, 0))
    ends = np.concatenate([place[:, side] for side in sides])
    long = np.concatenate([np.linalg.norm(vertices[faces[:, a]] - vertices[faces[:, b]], axis=1) for a, b in sides])
    owner = np.tile(np.arange(len(faces), dtype=np.int32), 3)
    edge = np.unique(np.sort(ends, 1), axis=0, return_inverse=True)[1].reshape(-1)
    order = np.argsort(edge, kind="stable")
    same = edge[order][1:] == edge[order][:-1]
    pair = np.stack([owner[order][:-1][same], owner[order][1:][same]], 1)
    return pair, long[order][:-1][same]
