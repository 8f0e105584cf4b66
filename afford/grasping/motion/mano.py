"""Joints and fingertips of the MANO hand from its angles, in numpy (Romero, Tzionas and Black 2017).

The model is licensed on its own and never part of this project: bring `mano_right.npz` and `mano_left.npz`, the arrays of v1.2
saved with numpy.savez. Its formulas are followed here; never run on the real model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from afford.common.bounded import load_npz
from afford.common.errors import SourceError
from schemas.files import FileRef

TIPS = {"right": (745, 317, 444, 556, 673), "left": (745, 317, 445, 556, 673)}
"""vertices at the fingertips, thumb first"""
OURS = np.array([0, 13, 14, 15, 16, 1, 2, 3, 17, 4, 5, 6, 18, 10, 11, 12, 19, 7, 8, 9, 20])
"""which of its 16 joints (wrist, index, middle, little, ring, thumb) and then 5 tips is each of ours"""
SHAPES = {"v_template": (778, 3), "shapedirs": (778, 3, 10), "posedirs": (778, 3, 135), "J_regressor": (16, 778),
          "weights": (778, 16), "kintree_table": (2, 16)}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Mano:
    """One hand's model."""

    side: str
    v_template: np.ndarray
    shapedirs: np.ndarray
    posedirs: np.ndarray
    J_regressor: np.ndarray
    weights: np.ndarray
    parents: np.ndarray


def read(file: FileRef, side: str) -> Mano:
    """The model in an .npz; SourceError when an array is missing or of another shape."""
    found = load_npz(file.path, file.name, SHAPES.__contains__)
    for name, shape in SHAPES.items():
        array = found.get(name)
        if array is None or array.shape != shape:
            got = "none" if array is None else str(array.shape)
            raise SourceError(f"{file.name}, {name}", f"numbers {shape}", got, "save all arrays of MANO v1.2")
        if array.dtype.kind not in "fiu" or not np.isfinite(array).all():
            raise SourceError(f"{file.name}, {name}", "finite numbers", f"others ({array.dtype})", "save all arrays of MANO v1.2")
    parents = found.pop("kintree_table")[0].astype(np.int64)
    if ((parents[1:] < 0) | (parents[1:] >= np.arange(1, len(parents)))).any():
        raise SourceError(f"{file.name}, kintree_table", "parents before their children", str(parents.tolist()),
                          "save all arrays of MANO v1.2")
    return Mano(side, **{name: numbers.astype(np.float64) for name, numbers in found.items()}, parents=parents)


def keypoints(model: Mano, quaternions: np.ndarray, betas: np.ndarray) -> np.ndarray:
    """(n, 16, 4) rotations x y z w relative to parents, flat mean; (n, 10) shape -> (n, 21, 3) with the wrist at the origin."""
    tips = list(TIPS[model.side])
    local = Rotation.from_quat(quaternions.reshape(-1, 4)).as_matrix().reshape(-1, 16, 3, 3)
    rest = model.v_template + np.einsum("vcb,nb->nvc", model.shapedirs, betas)
    joints = np.einsum("jv,nvc->njc", model.J_regressor, rest)
    R, places = _chain(local, joints, model.parents)
    bent = (local[:, 1:] - np.eye(3)).reshape(len(local), -1)
    there = rest[:, tips] + np.einsum("vcp,np->nvc", model.posedirs[tips], bent)
    moved = np.einsum("njab,nvjb->nvja", R, there[:, :, None] - joints[:, None]) + places[:, None]
    ends = np.einsum("vj,nvja->nva", model.weights[tips], moved)
    points = np.concatenate([places, ends], axis=1)
    found: np.ndarray = (points - places[:, :1])[:, OURS]
    return found


def _chain(local: np.ndarray, joints: np.ndarray, parents: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (n, 16, 3, 3) and places (n, 16, 3) of the joints; the first has no parent."""
    R, places = local.copy(), joints.copy()
    for k in range(1, len(parents)):
        up = parents[k]
        R[:, k] = R[:, up] @ local[:, k]
        places[:, k] = places[:, up] + np.einsum("nab,nb->na", R[:, up], joints[:, k] - joints[:, up])
    return R, places
