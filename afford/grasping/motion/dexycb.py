"""Read static human grasps of DexYCB as D-Grasp prepared them (.npz of plain arrays): one HandMotion of one frame per grasp.

The arrays of each object are `<DexYCB object id>/<field>`: final_ee_rel (n, 63), 21 joints x 3 in the object frame, metres. After
the wrist, D-Grasp lists index, middle, ring, little, thumb. This order was checked on the data: bone lengths are constant over
grasps, and the chain next to the index finger that starts 4 cm from the wrist is the thumb. The object frame is the world frame.
"""

from __future__ import annotations

import re
from pathlib import PurePosixPath

import numpy as np

from afford.common.bounded import load_npz
from afford.common.errors import SourceError
from afford.grasping.motion.keypoints import hand_motion
from schemas.files import FileRef, FileTree
from schemas.hand import PHASES, HandMotion

FIELD = "final_ee_rel"
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
    found = [file for file in files.files if PurePosixPath(file.name).suffix == ".npz"]
    if not found:
        raise SourceError(files.name, f"an .npz with <object id>/{FIELD}", "no .npz", "get DexYCB's grasps from D-Grasp")
    return tuple(motion for file in found for motion in _grasps(file))


def _grasps(file: FileRef) -> list[HandMotion]:
    found = load_npz(file.path, file.name, lambda name: name.partition("/")[2] == FIELD)
    tables = {name.partition("/")[0]: table for name, table in found.items()}
    if not tables:
        raise SourceError(file.name, f"arrays <object id>/{FIELD}", "other arrays", "use the keypoints reader for other files")
    unknown = [key for key in tables if not re.fullmatch("[0-9]{1,9}", key) or int(key) not in NAMES]
    if unknown:
        raise SourceError(file.name, "object ids 1 to 21", repr(unknown[0]), "correct the names of the arrays")
    return [grasp for key in sorted(tables, key=int) for grasp in _of_object(file.name, int(key), tables[key])]


def _of_object(where: str, number: int, table: np.ndarray) -> list[HandMotion]:
    if table.ndim != 2 or table.shape[1] != 63 or table.dtype.kind not in "fiu":
        got = f"{table.dtype} {table.shape}"
        raise SourceError(f"{where}, {number}/{FIELD}", "numbers (grasps, 63)", got, "21 joints x 3 in a row")
    hold, there = np.full(1, PHASES.index("hold"), np.uint8), np.array([[0.0, 0, 0, 0, 0, 0, 1]])
    return [hand_motion(f"{number:02d}_{NAMES[number]}_{k:03d}", "dexycb", "right", RATE_HZ, row.reshape(1, 21, 3)[:, OURS],
                  where=f"{where}, {number}/{FIELD}, row {k}", phase=hold, object_name=NAMES[number], object_pose=there)
            for k, row in enumerate(table)]  # fmt: skip
