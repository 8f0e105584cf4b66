"""What a camera can see of a world: the hand's collision shapes and the object's hulls, as triangles. No engine is asked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from afford.grasping.hand.kinematics import forward_kinematics
from afford.grasping.hand.link_meshes import link_meshes
from schemas.grasp import GraspObject
from schemas.hand import HandModel

SIDES = 12
"""corners around a capsule: a finger of 1 cm is nowhere more than 0.4 mm too thin"""


@dataclass(frozen=True, eq=False)
class HandShape:
    """Triangles of a hand."""

    hand: HandModel
    corners: np.ndarray
    """(v, 3) m, each in the frame of its link"""
    link: np.ndarray
    """(v,) index of that link"""
    faces: np.ndarray
    """(t, 3) int32"""

    def at(self, q: np.ndarray) -> np.ndarray:
        """(n, d) joints -> (n, v, 3) corners in the world."""
        T = forward_kinematics(self.hand.joints, q)[:, self.link]
        found: np.ndarray = (T[..., :3, :3] @ self.corners[:, :, None])[..., 0] + T[..., :3, 3]
        return found


@dataclass(frozen=True, eq=False)
class BodyShape:
    """Triangles of an object's hulls, in its frame."""

    corners: np.ndarray
    faces: np.ndarray

    def at(self, pose: np.ndarray) -> np.ndarray:
        """(7,) -> (v, 3) corners in the world."""
        found: np.ndarray = Rotation.from_quat(pose[3:]).apply(self.corners) + pose[:3]
        return found


def hand_shape(hand: HandModel) -> HandShape:
    """Of every link that can touch something. ValueError for a hand of which nothing can."""
    solids = link_meshes(hand, ("collision",), SIDES)
    if not solids:
        raise ValueError(f"{hand.name}: expected a link with a collision shape, got none; cameras would not see the hand")
    corners, faces = _joined([(one.vertices, one.faces) for one in solids])
    return HandShape(hand, corners, np.repeat([one.link for one in solids], [len(one.vertices) for one in solids]), faces)


def body_shape(body: GraspObject) -> BodyShape:
    """Of all its hulls."""
    solids = [trimesh.convex.convex_hull(hull) for hull in body.hulls()]
    return BodyShape(*_joined([(one.vertices, one.faces) for one in solids]))


def _joined(solids: Sequence[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """(v, 3) corners and (t, 3) faces of all."""
    ends = np.cumsum([0, *(len(corners) for corners, _ in solids)])
    faces = [np.asarray(one) + first for (_, one), first in zip(solids, ends[:-1], strict=True)]
    return np.concatenate([corners for corners, _ in solids]).astype(np.float64), np.concatenate(faces).astype(np.int32)
