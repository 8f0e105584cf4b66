"""Poses in which UniDexGrasp lays an object: the tables of its grasps.

A grasp file has `plane` (4,), or (k, 4) where it was converted from the file of all poses: tables A x + B y + C z + D = 0 in the
frame of the mesh, in metres, with (A, B, C) upwards; and `scale`, one over the size. Hand poses are pickled and not read.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from afford.common.bounded import load_npz
from afford.common.errors import SourceError
from afford.grasping.env.rest_choice import Turns
from afford.surface.meshes.unidexgrasp import GRASP
from schemas.files import FileRef, FileTree

FIELDS = ("plane", "scale")
HIGH_M = 0.05
"""tables farther below the origin of the mesh are left out, as in the released code"""
SAME = 0.995
"""cosine of two upward axes from which their poses are one"""


def listed_turns(files: FileTree, size: float) -> Turns:
    """Rotations that lay an object of a size as its grasps do, each with the steadiness 1; none without a grasp in this size.

    SourceError for a grasp file that cannot be read.
    """
    ups = list[np.ndarray]()
    for file in files.files:
        for up in _ups(file, size) if file.name.endswith(GRASP) else ():
            if not any(up @ other > SAME for other in ups):
                ups.append(up)
    return [(Rotation.align_vectors([[0.0, 0.0, 1.0]], [up])[0], 1.0) for up in ups]


def _ups(file: FileRef, size: float) -> np.ndarray:
    """Upward axes (k, 3) of a file; none for another size, or for a table far below the object."""
    found = load_npz(file.path, file.name, lambda key: key in FIELDS)
    plane, scale = (np.asarray(found.get(name, np.nan), np.float64) for name in FIELDS)
    plane = np.atleast_2d(plane)
    if plane.shape[1:] != (4,) or scale.size != 1 or not np.isfinite([*plane.ravel(), *scale.ravel()]).all() or scale.min() <= 0:
        raise SourceError(file.name, "planes of 4 numbers and one scale above 0", f"plane {plane.shape} and scale {scale.tolist()}",
                          "get the file again")  # fmt: skip
    length = np.linalg.norm(plane[:, :3], axis=1, keepdims=True)
    if not ((length > 0.9) & (length < 1.1)).all():
        raise SourceError(file.name, "planes whose normals have length 1", f"{length.min():.3g}", "get the file again")
    fits = (np.abs(1 / scale.ravel() - size) < 0.005) & (plane[:, 3] <= HIGH_M)
    ups: np.ndarray = (plane[:, :3] / length)[fits]
    return ups
