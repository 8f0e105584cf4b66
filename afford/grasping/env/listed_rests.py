"""Poses in which UniDexGrasp lays an object: the tables of its grasps.

A grasp file has `plane` (4,), the table as A x + B y + C z + D = 0 in the frame of the mesh, in metres, with (A, B, C) upwards, and
`scale`, one over the size of the object. Its hand poses are pickled and not read.
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
        up = _up(file, size) if file.name.endswith(GRASP) else None
        if up is not None and not any(up @ other > SAME for other in ups):
            ups.append(up)
    return [(Rotation.align_vectors([[0.0, 0.0, 1.0]], [up])[0], 1.0) for up in ups]


def _up(file: FileRef, size: float) -> np.ndarray | None:
    """Upward axis (3,) of a grasp; None for another size, or a table far below the object."""
    found = load_npz(file.path, file.name, lambda key: key in FIELDS)
    plane, scale = (np.asarray(found.get(name, np.nan), np.float64).ravel() for name in FIELDS)
    if plane.shape != (4,) or scale.shape != (1,) or not np.isfinite([*plane, *scale]).all() or scale[0] <= 0:
        raise SourceError(file.name, "plane of 4 numbers and one scale above 0", f"plane {plane.shape} and scale {scale.tolist()}",
                          "get the file again")  # fmt: skip
    length = float(np.linalg.norm(plane[:3]))
    if not 0.9 < length < 1.1:
        raise SourceError(file.name, "a plane whose normal has length 1", f"{length:.3g}", "get the file again")
    if abs(1 / scale[0] - size) > 0.005 or plane[3] > HIGH_M:
        return None
    up: np.ndarray = plane[:3] / length
    return up
