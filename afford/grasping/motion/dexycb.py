"""Read static human grasps of DexYCB as D-Grasp prepared them (.npz of plain arrays): one HandMotion of one frame per grasp.

The arrays of each object are `<DexYCB object id>/<field>`: final_ee_rel (n, 63), 21 joints x 3 in the object frame, metres. After
the wrist, D-Grasp lists index, middle, ring, little, thumb. This order was checked on the data: bone lengths are constant over
grasps, and the chain next to the index finger that starts 4 cm from the wrist is the thumb. The pose of the object before the
grasp, obj_pose_reset (n, 7), x y z and quaternion w x y z, gives the world with z up; without it the object frame is the world.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import PurePosixPath

import numpy as np
from scipy.spatial.transform import Rotation

from afford.common.bounded import load_npz
from afford.common.errors import SourceError
from afford.grasping.motion.keypoints import hand_motion
from schemas.files import FileRef, FileTree
from schemas.hand import PHASES, HandMotion

FIELD, POSE = "final_ee_rel", "obj_pose_reset"
OURS = np.array([0, *range(17, 21), *range(1, 17)])
"""index of each of our keypoints in their list"""
NAMES = {1: "master_chef_can", 2: "cracker_box", 3: "sugar_box", 4: "tomato_soup_can", 5: "mustard_bottle", 6: "tuna_fish_can",
         7: "pudding_box", 8: "gelatin_box", 9: "potted_meat_can", 10: "banana", 11: "pitcher_base", 12: "bleach_cleanser",
         13: "bowl", 14: "mug", 15: "power_drill", 16: "wood_block", 17: "scissors", 18: "large_marker", 19: "large_clamp",
         20: "extra_large_clamp", 21: "foam_brick"}  # fmt: skip
"""objects of DexYCB by id"""
RATE_HZ = 30.0
"""rate of DexYCB's cameras; a single frame has no speed"""


def read(files: FileTree) -> tuple[HandMotion, ...]:
    """Read all grasps of all .npz files, by object id; SourceError when there are none, or when one cannot be used."""
    return tuple(grasp for _, grasps in parts(files) for grasp in grasps())


def parts(files: FileTree) -> Iterator[tuple[str, Callable[[], tuple[HandMotion, ...]]]]:
    """Yield the name and the reader of every grasp; that of a whole file where the file cannot be used."""
    found = [file for file in files.files if PurePosixPath(file.name).suffix == ".npz"]
    if not found:
        raise SourceError(files.name, f"an .npz with <object id>/{FIELD}", "no .npz", "get DexYCB's grasps from D-Grasp")
    for file in found:
        try:
            rows = _rows(file)
        except SourceError as error:
            yield file.name, partial(_refuse, error)
        else:
            yield from rows


def _refuse(error: SourceError) -> tuple[HandMotion, ...]:
    raise error


def _rows(file: FileRef) -> list[tuple[str, Callable[[], tuple[HandMotion, ...]]]]:
    """List the grasps of a file."""
    found = load_npz(file.path, file.name, lambda name: name.partition("/")[2] in (FIELD, POSE))
    tables = {name.partition("/")[0]: table for name, table in found.items() if name.endswith("/" + FIELD)}
    if not tables:
        raise SourceError(file.name, f"arrays <object id>/{FIELD}", "other arrays", "use the keypoints reader for other files")
    unknown = [key for key in tables if not re.fullmatch("[0-9]{1,9}", key) or int(key) not in NAMES]
    if unknown:
        raise SourceError(file.name, "object ids 1 to 21", repr(unknown[0]), "correct the names of the arrays")
    out = list[tuple[str, Callable[[], tuple[HandMotion, ...]]]]()
    for key in sorted(tables, key=int):
        _check(f"{file.name}, {key}/{FIELD}", tables[key], 63, len(tables[key]) if tables[key].ndim else 0)
        poses = found.get(f"{key}/{POSE}")
        if poses is not None:
            _check(f"{file.name}, {key}/{POSE}", poses, 7, len(tables[key]))
        out += [(_name(int(key), k), partial(_grasp, file.name, int(key), k, row, None if poses is None else poses[k]))
                for k, row in enumerate(tables[key])]  # fmt: skip
    return out


def _check(where: str, table: np.ndarray, width: int, rows: int) -> None:
    if table.ndim != 2 or table.shape != (rows, width) or table.dtype.kind not in "fiu":
        got = f"{table.dtype} {table.shape}"
        raise SourceError(where, f"numbers (grasps, {width})", got, "21 joints x 3, and a pose of 7 numbers, in a row")


def _name(number: int, k: int) -> str:
    return f"{number:02d}_{NAMES[number]}_{k:03d}"


def _grasp(where: str, number: int, k: int, row: np.ndarray, pose: np.ndarray | None) -> tuple[HandMotion, ...]:
    there = np.array([0.0, 0, 0, 0, 0, 0, 1]) if pose is None else pose[[0, 1, 2, 4, 5, 6, 3]]
    points = row.reshape(1, 21, 3)[:, OURS]
    if np.isfinite(there).all() and np.linalg.norm(there[3:]) > 0:  # other poses are reported by hand_motion
        points = points @ Rotation.from_quat(there[3:]).as_matrix().T + there[:3]
    return (hand_motion(_name(number, k), "dexycb", "right", RATE_HZ, points, where=f"{where}, {number}/{FIELD}, row {k}",
                        phase=np.full(1, PHASES.index("hold"), np.uint8), object_name=NAMES[number],
                        object_pose=there[None]),)  # fmt: skip
