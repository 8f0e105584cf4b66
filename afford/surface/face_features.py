"""Features of mesh faces (colour, shape diameter), and the strength of the borders between neighbouring faces."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from afford.render.views.surface import Rays, face_areas
from schemas.mesh import ObjectMesh

CONE = 7
"""rays of a shape diameter"""
CONE_DEG = 30.0
COLOUR_PX = 512
"""largest texture side from which colours are sampled, so that print does not count as a part"""


@dataclass(frozen=True, eq=False)
class FaceFeatures:
    """Features of faces: position, normal, area, colour, thickness.

    `middle` (f, 3) and `normal` (f, 3) float64, `area` (f,) m^2, `colour` (f, 3) float32 CIE Lab, `thickness` (f,) m, the shape
    diameter.
    """

    middle: np.ndarray
    normal: np.ndarray
    area: np.ndarray
    colour: np.ndarray
    thickness: np.ndarray

    @staticmethod
    def of(mesh: ObjectMesh) -> FaceFeatures:
        """Compute the features of every face."""
        corner = mesh.vertices[mesh.faces].astype(np.float64)
        area, normal = face_areas(corner)
        middle = corner.mean(1)
        return FaceFeatures(middle, normal, area, face_colours(mesh), shape_diameter(mesh, middle, normal))


def face_colours(mesh: ObjectMesh) -> np.ndarray:
    """Sample the texture at the centre of each face: (f, 3) float32 CIE Lab."""
    scale = min(1.0, COLOUR_PX / max(mesh.texture.shape[:2]))
    size = tuple(max(1, round(side * scale)) for side in mesh.texture.shape[1::-1])
    small = cv2.resize(mesh.texture, size, interpolation=cv2.INTER_AREA)
    lab = cv2.cvtColor(small.astype(np.float32) / 255, cv2.COLOR_RGB2Lab)
    u, v = mesh.uv.mean(1).T % 1.0
    found = cv2.remap(lab, (u * size[0] - 0.5).astype(np.float32)[:, None], ((1 - v) * size[1] - 0.5).astype(np.float32)[:, None],
                      cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # fmt: skip
    return np.asarray(found[:, 0])


def shape_diameter(mesh: ObjectMesh, middle: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Compute the shape diameter (f,) float64 in metres (Shapira et al. 2008).

    It is the median length of a cone of rays from a face into the object.
    """
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
    """Return (CONE, f, 3) unit vectors around each axis (f, 3): the axis and a ring."""
    helper = np.where(np.abs(axis[:, :1]) < 0.9, [[1.0, 0, 0]], [[0, 1.0, 0]])
    right = np.cross(axis, helper)
    right /= np.maximum(np.linalg.norm(right, axis=1, keepdims=True), 1e-12)
    up = np.cross(axis, right)
    turns = np.arange(CONE - 1) * (2 * np.pi / (CONE - 1))
    tilt = np.radians(CONE_DEG)
    ring = [np.cos(tilt) * axis + np.sin(tilt) * (np.cos(t) * right + np.sin(t) * up) for t in turns]
    return np.stack([axis, *ring])


MERGE = 1e-6
"""vertices closer than this share of the object's size are one vertex"""


@dataclass(frozen=True)
class BorderWeights:
    """Weights of the terms of a border's strength."""

    concave: float = 1.0
    """weight of a concave angle, per radian: parts meet in creases (minima rule, Hoffman and Richards 1984)"""
    convex: float = 0.15
    """weight of a convex angle, per radian"""
    colour: float = 0.02
    """weight of a unit of CIE Lab"""
    thickness: float = 0.5
    """weight of a change of thickness by a factor e"""


@dataclass(frozen=True, eq=False)
class Borders:
    """Edges between faces: pairs (e, 2) int32, length (e,) m, strength (e,) as a border between parts."""

    pair: np.ndarray
    length: np.ndarray
    strength: np.ndarray

    @staticmethod
    def of(vertices: np.ndarray, faces: np.ndarray, features: FaceFeatures, weights: BorderWeights) -> Borders:
        """Compute the borders between all faces that share an edge."""
        pair, length = shared_edges(vertices, faces)
        a, b = pair.T
        bend = np.arccos((features.normal[a] * features.normal[b]).sum(1).clip(-1, 1))
        inwards = ((features.middle[b] - features.middle[a]) * features.normal[a]).sum(1) > 0
        tint = np.linalg.norm(features.colour[a] - features.colour[b], axis=1)
        thick = np.abs(np.log(features.thickness[a] / features.thickness[b]))
        strength = bend * np.where(inwards, weights.concave, weights.convex) + weights.colour * tint + weights.thickness * thick
        return Borders(pair, length, strength)


def shared_edges(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the faces (e, 2) int32 on both sides of each edge, and its length (e,).

    Vertices at the same position count as one, so that texture seams separate nothing. Where more than two faces share an edge,
    they are paired in their order.
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
