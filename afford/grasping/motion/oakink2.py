"""Read OakInk2 after `oakink2_import`: sequences of both hands, cut into primitives, one HandMotion per hand and primitive.

Reads <sequence>.npz and <sequence>.json, mano_right.npz, mano_left.npz. Motion capture runs at 120 Hz; quaternions w x y z become
x y z w; `tsl` is the position of the wrist. Intervals count frames of the motion capture.

Keypoints come from the MANO hand model, evaluated in numpy (Romero, Tzionas and Black 2017). MANO has its own licence and is not
part of this project: bring the arrays of v1.2, saved with numpy.savez. Written after the data set's toolkit and description;
tested on files in its format; never run on the real set or the real model.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import PurePosixPath
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from afford.common import text
from afford.common.bounded import TooLargeError, load_npz, reason
from afford.common.errors import SourceError
from afford.grasping.motion.keypoints import hand_motion
from schemas.files import FileRef, FileTree
from schemas.hand import HandMotion

TIPS = {"right": (745, 317, 444, 556, 673), "left": (745, 317, 445, 556, 673)}
"""vertices at the fingertips, thumb first"""
OURS = np.array([0, 13, 14, 15, 16, 1, 2, 3, 17, 4, 5, 6, 18, 10, 11, 12, 19, 7, 8, 9, 20])
"""index of each of our keypoints among MANO's 16 joints (wrist, index, middle, little, ring, thumb) and 5 tips"""
SHAPES = {"v_template": (778, 3), "shapedirs": (778, 3, 10), "posedirs": (778, 3, 135), "J_regressor": (16, 778),
          "weights": (778, 16), "kintree_table": (2, 16)}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Mano:
    """MANO model of one hand."""

    side: str
    v_template: np.ndarray
    shapedirs: np.ndarray
    posedirs: np.ndarray
    J_regressor: np.ndarray
    weights: np.ndarray
    parents: np.ndarray


def read_mano(file: FileRef, side: str) -> Mano:
    """Read a model from an .npz; SourceError when an array is missing or has another shape."""
    found = load_npz(file.path, file.name, SHAPES.__contains__)
    for name, shape in SHAPES.items():
        array = found.get(name)
        if array is None or array.shape != shape:
            got = "no such array" if array is None else str(array.shape)
            raise SourceError(f"{file.name}, {name}", f"numbers {shape}", got, "save all arrays of MANO v1.2")
        if array.dtype.kind not in "fiu" or not np.isfinite(array).all():
            raise SourceError(f"{file.name}, {name}", "finite numbers", f"others ({array.dtype})", "save all arrays of MANO v1.2")
    parents = found.pop("kintree_table")[0].astype(np.int64)
    if ((parents[1:] < 0) | (parents[1:] >= np.arange(1, len(parents)))).any():
        raise SourceError(f"{file.name}, kintree_table", "parents before their children", str(parents.tolist()),
                          "save all arrays of MANO v1.2")
    return Mano(side, **{name: numbers.astype(np.float64) for name, numbers in found.items()}, parents=parents)


def keypoints(model: Mano, quaternions: np.ndarray, betas: np.ndarray) -> np.ndarray:
    """Compute 21 keypoints with the wrist at the origin, (n, 21, 3).

    quaternions (n, 16, 4) are rotations x y z w relative to parents, for a flat mean hand; betas (n, 10) is the shape.
    """
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
    """Chain local rotations: rotations (n, 16, 3, 3) and positions (n, 16, 3) of the joints; the first joint is the root."""
    R, places = local.copy(), joints.copy()
    for k in range(1, len(parents)):
        up = parents[k]
        R[:, k] = R[:, up] @ local[:, k]
        places[:, k] = places[:, up] + np.einsum("nab,nb->na", R[:, up], joints[:, k] - joints[:, up])
    return R, places


RATE_HZ = 120.0
SIDES = ("left", "right")
"""order of the two intervals in a program's key"""
SHORT = {"left": "lh", "right": "rh"}
FIELDS = {"pose": (16, 4), "tsl": (3,), "betas": (10,)}
OBJECT = "object/"
MOST_TIMES = 8
"""primitives of a hand that a frame may be part of, on average"""
IMPORT = "make it with python -m afford.grasping.motion.oakink2_import"


def read(files: FileTree) -> tuple[HandMotion, ...]:
    """Read all primitives of all sequences; SourceError when a file is missing or cannot be used."""
    return tuple(motion for _, motions in parts(files) for motion in motions())


def parts(files: FileTree) -> Iterator[tuple[str, Callable[[], tuple[HandMotion, ...]]]]:
    """Yield the name and the reader of every sequence; SourceError without the hand models, or without sequences."""
    models = {side: read_mano(_file(files, f"mano_{side}.npz", "save MANO v1.2 there"), side) for side in SIDES}
    sequences = [f for f in files.files if f.name.endswith(".npz") and not PurePosixPath(f.name).name.startswith("mano_")]
    if not sequences:
        raise SourceError(files.name, "a sequence (.npz)", "no such file", IMPORT)
    for file in sequences:
        yield file.name, partial(_sequence, files, file, models)


def _sequence(files: FileTree, file: FileRef, models: dict[str, Mano]) -> tuple[HandMotion, ...]:
    program_file = _file(files, file.name.removesuffix(".npz") + ".json", IMPORT)
    arrays = _checked(load_npz(file.path, file.name, _is_known), file.name)
    wanted = [(side, interval, entry) for key, entry in _program(program_file).items()
              for side, interval in zip(SIDES, _intervals(program_file.name, key), strict=True) if interval]
    if sum(end - start for _, (start, end), _ in wanted) > MOST_TIMES * len(SIDES) * len(arrays["frames"]):
        limit = f"frames in at most {MOST_TIMES} primitives of a hand"
        raise TooLargeError(program_file.name, limit, "more", "get the file again")
    return tuple(_clip(file, arrays, models[side], interval, entry) for side, interval, entry in wanted)


def _program(file: FileRef) -> dict[str, dict[str, Any]]:
    """Read the primitives: interval -> its entry."""
    found = text.parse_json(file.path.read_bytes(), file.name)
    good = isinstance(found, dict) and all(
        isinstance(entry, dict) and all(_names(entry.get(f"obj_list_{short}")) for short in SHORT.values())
        for entry in found.values())  # fmt: skip
    if not good:
        raise SourceError(file.name, "an object of primitives with lists of names", "something else", "get the file again")
    return dict(found)


def _names(value: Any) -> bool:
    return value is None or (isinstance(value, list) and all(isinstance(name, str) for name in value))


def _is_known(name: str) -> bool:
    return name == "frames" or name.startswith(("left/", "right/", OBJECT))


def _checked(arrays: dict[str, np.ndarray], where: str) -> dict[str, np.ndarray]:
    """Check the arrays of a sequence; SourceError when one is missing or has another shape."""
    frames = arrays.get("frames", np.zeros(0))
    if frames.ndim != 1 or not len(frames) or frames.dtype.kind not in "iu":
        raise SourceError(f"{where}, frames", "whole numbers (n,)", f"{frames.dtype} {frames.shape}", IMPORT)
    if (np.diff(frames) <= 0).any():
        row = int((np.diff(frames) <= 0).argmax()) + 1
        raise SourceError(f"{where}, frames", "rising frame numbers", f"{frames[row]} after {frames[row - 1]}", IMPORT)
    shapes = {f"{side}/{field}": shape for side in SIDES for field, shape in FIELDS.items()}
    shapes |= {name: (4, 4) for name in arrays if name.startswith(OBJECT)}
    for name, shape in shapes.items():
        array = arrays.get(name)
        if array is None or array.shape != (len(frames), *shape) or array.dtype.kind not in "fiu":
            got = "no such array" if array is None else f"{array.dtype} {array.shape}"
            raise SourceError(f"{where}, {name}", f"numbers {(len(frames), *shape)}", got, IMPORT)
    return arrays


def _clip(file: FileRef, arrays: dict[str, np.ndarray], model: Mano, interval: tuple[int, int], entry: Any) -> HandMotion:
    start, end = interval
    part = (arrays["frames"] >= start) & (arrays["frames"] < end)
    short = SHORT[model.side]
    where = f"{file.name}, {short} {start}-{end}"
    if part.sum() != end - start:
        raise SourceError(where, f"{end - start} frames of motion capture", f"{part.sum()}", "get the sequence again")
    pose, tsl, betas = (arrays[f"{model.side}/{field}"][part] for field in ("pose", "tsl", "betas"))
    held = [name for name in entry.get(f"obj_list_{short}") or [] if OBJECT + name in arrays]
    try:
        points = keypoints(model, pose[..., [1, 2, 3, 0]], betas) + tsl[:, None]
        track = _poses(arrays[OBJECT + held[0]][part]) if held else None
    except ValueError as error:  # SciPy raises it for invalid rotations
        raise SourceError(where, "rotations", reason(error), "get the sequence again") from error
    name = f"{file.name.removesuffix('.npz')}_{short}_{start:05d}_{entry.get(f'primitive_{short}') or 'hold'}"
    return hand_motion(name, "oakink2", model.side, RATE_HZ, points, where=where, object_name=held[0] if held else "",
                       object_pose=track)  # fmt: skip


def _poses(T: np.ndarray) -> np.ndarray:
    """Convert poses (n, 4, 4) to (n, 7)."""
    return np.concatenate([T[:, :3, 3], Rotation.from_matrix(T[:, :3, :3]).as_quat()], axis=1)


def _intervals(where: str, key: str) -> tuple[tuple[int, int] | None, tuple[int, int] | None]:
    """Parse the two intervals of a key such as '((10, 90), None)'."""
    try:
        left, right = (None if one is None else (int(one[0]), int(one[1])) for one in ast.literal_eval(key))
    except (ValueError, SyntaxError, TypeError, LookupError, OverflowError, RecursionError, MemoryError) as error:
        raise SourceError(where, "keys (left interval or None, right interval or None)", repr(key), "get the file again") from error
    return left, right


def _file(files: FileTree, name: str, fix: str) -> FileRef:
    found = files.find(name)
    if found is None:
        raise SourceError(files.name, f"a file {name}", "no such file", fix)
    return found
