"""Parts of a rigid body: one, the pieces of its convex decomposition, or those of its mesh.

Predicted parts are patches that need not follow the shape. A body whose pieces may not span two of them stands out of its mesh
further, so that hands meet what is not there; so bodies with such parts are cut by their shape alone, and then get their parts.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import ConvexHull

from afford.grasping.sim.grasp_object import UNNAMED
from afford.surface.meshes.nearest import NearestSurface
from schemas.grasp import GraspObject
from schemas.mesh import MeshParts, ObjectMesh


def whole(parts: MeshParts) -> MeshParts:
    """One part with all faces."""
    return replace(parts, names=("whole",), part=np.zeros_like(parts.part))


def one_part(body: GraspObject) -> GraspObject:
    """Body whose only part is the whole."""
    return replace(body, parts=("whole",), hull_part=np.zeros_like(body.hull_part), point_part=np.zeros_like(body.point_part))


def parted_by_pieces(body: GraspObject) -> GraspObject:
    """Body whose parts are the pieces of its convex decomposition: each point belongs to the hull that it is deepest in."""
    hulls = len(body.hull_part)
    names, hull_part = tuple(f"piece {k}" for k in range(hulls)), np.arange(hulls, dtype=np.int16)
    return replace(body, parts=names, hull_part=hull_part, point_part=_depth_m(body).argmax(axis=0).astype(np.int16))


def parted_as_mesh(body: GraspObject, mesh: ObjectMesh, parts: MeshParts) -> GraspObject:
    """Body with the parts of its mesh: a point has that of its face, a hull that of most points that are deepest in it."""
    names = parts.names if (parts.part >= 0).all() else (*parts.names, UNNAMED)
    part = np.where(parts.part >= 0, parts.part, len(parts.names))
    point_part = part[NearestSurface(mesh.vertices, mesh.faces)(body.points.astype(np.float64))[0]]
    depth = _depth_m(body)
    mine = [point_part[depth.argmax(axis=0) == k] for k in range(len(depth))]
    hull_part = [np.bincount(own).argmax() if len(own) else point_part[depth[k].argmax()] for k, own in enumerate(mine)]
    return replace(body, parts=names, hull_part=np.array(hull_part, np.int16), point_part=point_part.astype(np.int16))


def _depth_m(body: GraspObject) -> np.ndarray:
    """(h, n) depth of each point in each hull; negative outside."""
    planes = [ConvexHull(corners).equations for corners in body.hulls()]
    return -np.stack([(body.points @ one[:, :3].T + one[:, 3]).max(axis=1) for one in planes])
