"""Where two faces meet: how strongly the border between them looks like one between parts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from afford.surface.segments.features import FaceFeatures

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
