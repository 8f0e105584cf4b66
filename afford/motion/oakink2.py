"""OakInk2, after oakink2_import: sequences of both hands cut into their primitives -> one HandMotion for each hand of each.

Reads <sequence>.npz and <sequence>.json, mano_right.npz, mano_left.npz. Motion capture at 120 Hz; quaternions w x y z become
x y z w; a wrist is where `tsl` says. Intervals count frames of the motion capture. Written after the data set's toolkit and
description; tested on files in its format; never run on the real set.
"""

from __future__ import annotations

import ast
import zipfile
from pathlib import PurePosixPath
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from afford.motion import mano
from afford.motion.build import build
from afford.readers import strict_json
from afford.readers.errors import SourceError
from schemas.files import FileRef, FileTree
from schemas.motion import HandMotion

RATE_HZ = 120.0
SIDES = ("left", "right")
"""order of the two intervals in a program's key"""
IMPORT = "make it with python -m afford.motion.oakink2_import"


def read(files: FileTree) -> tuple[HandMotion, ...]:
    """All primitives of all sequences; SourceError when a file is missing or cannot be used."""
    models = {side: mano.read(_file(files, f"mano_{side}.npz", "save MANO v1.2 so"), side) for side in SIDES}
    sequences = [f for f in files.files if f.name.endswith(".npz") and not PurePosixPath(f.name).name.startswith("mano_")]
    if not sequences:
        raise SourceError(files.name, "a sequence (.npz)", "none", IMPORT)
    return tuple(motion for file in sequences for motion in _sequence(files, file, models))


def _sequence(files: FileTree, file: FileRef, models: dict[str, mano.Mano]) -> list[HandMotion]:
    program_file = _file(files, file.name.removesuffix(".npz") + ".json", IMPORT)
    program = strict_json.parse(program_file.path.read_bytes(), program_file.name)
    try:
        with np.load(file.path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except (ValueError, OSError, zipfile.BadZipFile) as error:
        raise SourceError(file.name, "an .npz of plain arrays", str(error), IMPORT) from error
    out = []
    for key, entry in program.items():
        for side, interval in zip(SIDES, _intervals(program_file.name, key), strict=True):
            if interval is not None:
                out.append(_clip(file, arrays, models[side], interval, entry))
    return out


def _clip(file: FileRef, arrays: dict[str, np.ndarray], model: mano.Mano, interval: tuple[int, int], entry: Any) -> HandMotion:
    start, end = interval
    part = (arrays["frames"] >= start) & (arrays["frames"] < end)
    short = "lh" if model.side == "left" else "rh"
    where = f"{file.name}, {short} {start}-{end}"
    if part.sum() != end - start:
        raise SourceError(where, f"{end - start} frames of motion capture", f"{part.sum()}", "get the sequence again")
    pose, tsl, betas = (arrays[f"{model.side}/{field}"][part] for field in ("pose", "tsl", "betas"))
    points = mano.keypoints(model, pose[..., [1, 2, 3, 0]], betas) + tsl[:, None]
    held = [name for name in entry.get(f"obj_list_{short}") or [] if f"object/{name}" in arrays]
    track = _poses(arrays[f"object/{held[0]}"][part]) if held else None
    name = f"{file.name.removesuffix('.npz')}_{short}_{start:05d}_{entry.get(f'primitive_{short}') or 'hold'}"
    return build(name, "oakink2", model.side, RATE_HZ, points, where=where, object_name=held[0] if held else "", object_pose=track)


def _poses(T: np.ndarray) -> np.ndarray:
    """(n, 4, 4) -> (n, 7)."""
    return np.concatenate([T[:, :3, 3], Rotation.from_matrix(T[:, :3, :3]).as_quat()], axis=1)


def _intervals(where: str, key: str) -> tuple[tuple[int, int] | None, tuple[int, int] | None]:
    """The two intervals of a key such as '((10, 90), None)'."""
    try:
        left, right = (None if one is None else (int(one[0]), int(one[1])) for one in ast.literal_eval(key))
    except (ValueError, SyntaxError, TypeError, IndexError) as error:
        raise SourceError(where, "keys (left interval or None, right interval or None)", repr(key), "get the file again") from error
    return left, right


def _file(files: FileTree, name: str, fix: str) -> FileRef:
    found = files.find(name)
    if found is None:
        raise SourceError(files.name, f"a file {name}", "none", fix)
    return found
