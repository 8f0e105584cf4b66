"""Pixels of views vote on the faces behind them: exact, since every pixel knows its face."""

from __future__ import annotations

import numpy as np

from afford.render.views.surface import face_areas
from schemas.mesh import ObjectMesh, ObjectViews


def vote_on_faces(face: np.ndarray, value: np.ndarray, weight: np.ndarray, faces: int) -> tuple[np.ndarray, np.ndarray]:
    """Weighted mean (f,) float32 of what the pixels of each face say, 0 where none has weight, and the sum of their weights (f,).

    `face` (n, h, w) int32, -1 beside the object; `value` (n, h, w) 0..1; `weight` (n, h, w), none negative.
    """
    on = face >= 0
    index, w = face[on], weight[on].astype(np.float64)
    total = np.bincount(index, w, faces)
    said = np.bincount(index, w * value[on], faces)
    return np.divide(said, total, out=np.zeros(faces), where=total > 0).astype(np.float32), total.astype(np.float32)


def cos_incidence(mesh: ObjectMesh, views: ObjectViews) -> np.ndarray:
    """(n, h, w) float32: cosine of the angle between line of sight and face normal at each pixel, 0 beside the object.

    Faces seen from behind (of an open surface) count as from before.
    """
    normal = face_areas(mesh.vertices[mesh.faces].astype(np.float64))[1]
    out = np.zeros(views.face.shape, np.float32)
    for one, face, K, T in zip(out, views.face, views.K, views.T_obj_cam, strict=True):
        y, x = np.nonzero(face >= 0)
        sight = np.stack([(x - K[0, 2]) / K[0, 0], (y - K[1, 2]) / K[1, 1], np.ones(len(x))], 1) @ T[:3, :3].T
        sight /= np.linalg.norm(sight, axis=1, keepdims=True)
        one[y, x] = np.abs((sight * normal[face[y, x]]).sum(1))
    return out
