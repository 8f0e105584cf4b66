"""Build a HandMotion from keypoints, and read clips in this project's own keypoint format (.npz, .json or .csv).

docs/grasping/motion-format.md describes the format. The readers of other data sets share the checks of `hand_motion`.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import PurePosixPath
from typing import Any

import numpy as np

from afford.common import text
from afford.common.bounded import load_npz
from afford.common.errors import SourceError
from afford.common.text import read_utf8
from schemas.files import FileRef, FileTree
from schemas.hand import KEYPOINTS, PHASES, HandMotion

FIELDS = ("keypoints", "fps", "hand", "unit", "time", "phase", "object_name", "object_pose", "palm")
UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001}
COLUMNS = tuple(f"{point}_{axis}" for point in KEYPOINTS for axis in "xyz")


def read(files: FileTree) -> tuple[HandMotion, ...]:
    """Read one clip from each file; SourceError when there is none, or when one cannot be used."""
    return tuple(motion for _, motions in parts(files) for motion in motions())


def parts(files: FileTree) -> Iterator[tuple[str, Callable[[], tuple[HandMotion, ...]]]]:
    """Yield the name and the reader of every file of keypoints; SourceError when there is none."""
    found = [file for file in files.files if PurePosixPath(file.name).suffix.lower() in READERS]
    if not found:
        raise SourceError(files.name, "a file of keypoints (.npz, .json or .csv)", "other files", DOCS)
    for file in found:
        yield file.name, partial(_read, file)


def _read(file: FileRef) -> tuple[HandMotion, ...]:
    return (_motion(file, READERS[PurePosixPath(file.name).suffix.lower()](file)),)


def _motion(file: FileRef, record: Mapping[str, Any]) -> HandMotion:
    unknown = sorted(set(record) - set(FIELDS))
    if unknown:
        raise SourceError(file.name, f"fields of {', '.join(FIELDS)}", unknown[0], DOCS)
    unit = _text(file, record, "unit")
    if unit not in UNITS:
        raise SourceError(f"{file.name}, unit", " or ".join(UNITS), repr(unit), DOCS)
    keypoints = _numbers(file, record, "keypoints")
    pose, palm = (_numbers(file, record, field) if field in record else None for field in ("object_pose", "palm"))
    if pose is not None and pose.ndim == 2:
        pose[:, :3] *= UNITS[unit]
    if palm is not None and palm.shape[1:] == (4, 4):
        palm[:, :3, 3] *= UNITS[unit]
    rate = _numbers(file, record, "fps")
    if rate.size != 1:
        raise SourceError(f"{file.name}, fps", "one number", f"{rate.size}", DOCS)
    if "time" in record:
        _check_times(file.name, _numbers(file, record, "time"), len(keypoints) if keypoints.ndim else 0, float(rate.item()))
    return hand_motion(str(PurePosixPath(file.name).with_suffix("")), "keypoints", _text(file, record, "hand"), float(rate.item()),
                 keypoints * UNITS[unit], where=file.name, phase=_phase(file, record) if "phase" in record else None,
                 object_name=_text(file, record, "object_name", ""), object_pose=pose, T_world_palm=palm)  # fmt: skip


def _text(file: FileRef, record: Mapping[str, Any], field: str, default: str | None = None) -> str:
    value = record.get(field, default)
    value = value.item() if isinstance(value, np.ndarray) and value.ndim == 0 else value
    if not isinstance(value, str):
        raise SourceError(f"{file.name}, {field}", "a text", "nothing" if value is None else type(value).__name__, DOCS)
    return value


def _numbers(file: FileRef, record: Mapping[str, Any], field: str) -> np.ndarray:
    if field not in record:
        raise SourceError(f"{file.name}, {field}", "numbers", "nothing", DOCS)
    try:
        return np.array(record[field], np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise SourceError(f"{file.name}, {field}", "numbers in rows of one length", str(error), DOCS) from error


def _check_times(where: str, seconds: np.ndarray, frames: int, rate_hz: float) -> None:
    """Check that frames are in order and without gaps."""
    if seconds.shape != (frames,) or not np.isfinite(seconds).all():
        raise SourceError(f"{where}, time", f"finite seconds ({frames},), one for each frame", f"{seconds.shape}", DOCS)
    steps = np.diff(seconds)
    if (steps <= 0).any():
        early = int((steps <= 0).argmax()) + 1
        raise SourceError(f"{where}, time", "rising seconds", f"{seconds[early]:g} after {seconds[early - 1]:g} in frame {early}",
                          "sort the frames")
    if (steps > GAP_FRAMES / rate_hz).any():
        raise SourceError(f"{where}, time", f"a frame every {1 / rate_hz:.3g} s", f"a gap of {steps.max():.3g} s after frame "
                          f"{int(steps.argmax())}", "cut the clip there, or fill the gap")


def _phase(file: FileRef, record: Mapping[str, Any]) -> np.ndarray:
    given = record["phase"]
    words = [str(word) for word in (given if isinstance(given, list) else np.atleast_1d(given))]
    wrong = next((word for word in words if word not in PHASES), None)
    if wrong is not None:
        raise SourceError(f"{file.name}, phase", f"words of {', '.join(PHASES)}", repr(wrong), DOCS)
    return np.array([PHASES.index(word) for word in words], np.uint8)


def _npz(file: FileRef) -> dict[str, Any]:
    return dict(load_npz(file.path, file.name))


def _json(file: FileRef) -> dict[str, Any]:
    record = text.parse_json(file.path.read_bytes(), file.name)
    if not isinstance(record, dict):
        raise SourceError(file.name, "an object with fields", type(record).__name__, DOCS)
    return record


def _csv(file: FileRef) -> dict[str, Any]:
    """Read one row for each frame: columns <point>_<x, y or z>; hand, fps, unit, time, phase and object_name are on every row."""
    try:
        rows = list(csv.DictReader(io.StringIO(read_utf8(file.path, file.name), newline=None)))
    except csv.Error as error:
        raise SourceError(file.name, "a CSV file", str(error), DOCS) from error
    missing = [column for column in (*COLUMNS, "hand", "fps", "unit") if not rows or not rows[0].get(column)]
    if missing:
        raise SourceError(file.name, f"a column {missing[0]}, and a row", "neither or one of them", DOCS)
    record: dict[str, Any] = {field: rows[0][field] for field in ("hand", "fps", "unit", "object_name") if field in rows[0]}
    for field, value in record.items():
        other = next((number for number, row in enumerate(rows, 2) if row[field] != value), None)
        if other is not None:
            raise SourceError(f"{file.name}, line {other}, {field}", f"{value!r} as in line 2", repr(rows[other - 2][field]), DOCS)
    try:
        numbers = np.array([[float(row[column]) for column in COLUMNS] for row in rows])
    except (TypeError, ValueError) as error:
        raise SourceError(file.name, "a number in every column of a keypoint", str(error), DOCS) from error
    more = {field: [row[field] for row in rows] for field in ("phase", "time") if field in rows[0]}
    return record | more | {"keypoints": numbers.reshape(-1, 21, 3)}


READERS: Mapping[str, Callable[[FileRef], dict[str, Any]]] = {".npz": _npz, ".json": _json, ".csv": _csv}
"""reader of each file format"""
HAND_M = (0.04, 0.16)
"""wrist to middle knuckle, from small children to the largest adults, with a margin"""
RATE_HZ = (1.0, 1000.0)
GAP_FRAMES = 1.5
"""time between two frames, in frames at the stated rate, from which one is missing"""
DOCS = "see docs/grasping/motion-format.md"


def hand_motion(name: str, source: str, side: str, rate_hz: float, keypoints: np.ndarray, *, where: str,
                phase: np.ndarray | None = None, object_name: str = "", object_pose: np.ndarray | None = None,
                T_world_palm: np.ndarray | None = None) -> HandMotion:  # fmt: skip
    """Build a motion from keypoints (t, 21, 3), in the order of KEYPOINTS, and optional arrays.

    phase (t,); object_pose (t, 7) with quaternions x y z w of any length except 0; T_world_palm (t, 4, 4). None stands for
    unknown. SourceError names `where` when the numbers cannot belong to a hand in metres.
    """
    _check(side, rate_hz, keypoints, where)
    frames = len(keypoints)
    given = {"phase": (phase, (frames,)), "object_pose": (object_pose, (frames, 7)), "T_world_palm": (T_world_palm, (frames, 4, 4))}
    for field, (numbers, shape) in given.items():
        if numbers is not None and (np.shape(numbers) != shape or not np.isfinite(numbers).all()):
            raise SourceError(f"{where}, {field}", f"finite numbers {shape}, one row for each frame", f"{np.shape(numbers)}",
                              "make them as long as the keypoints, or leave them out")
    phases = np.zeros(frames, np.uint8) if phase is None else np.asarray(phase)
    if ((phases < 0) | (phases >= len(PHASES))).any():
        raise SourceError(f"{where}, phase", f"0 to {len(PHASES) - 1}: {', '.join(PHASES)}", f"{phases.max()}", DOCS)
    return HandMotion(
        name, source, side, float(rate_hz), np.array(keypoints, np.float64), phases.astype(np.uint8), object_name,
        np.zeros((0, 7)) if object_pose is None else _unit(np.array(object_pose, np.float64), where),
        np.zeros((0, 4, 4)) if T_world_palm is None else np.array(T_world_palm, np.float64))  # fmt: skip


def _check(side: str, rate_hz: float, keypoints: np.ndarray, where: str) -> None:
    if side not in ("left", "right"):
        raise SourceError(f"{where}, hand", "left or right", repr(side), DOCS)
    if not RATE_HZ[0] <= rate_hz <= RATE_HZ[1]:
        raise SourceError(f"{where}, fps", f"{RATE_HZ[0]:g} to {RATE_HZ[1]:g} frames a second", f"{rate_hz}", DOCS)
    if keypoints.ndim != 3 or keypoints.shape[1:] != (21, 3) or len(keypoints) == 0:
        raise SourceError(f"{where}, keypoints", "numbers (frames, 21, 3), one frame at least", f"{keypoints.shape}", DOCS)
    wrong = ~np.isfinite(keypoints).all(axis=(1, 2))
    if wrong.any():
        raise SourceError(f"{where}, keypoints", "finite numbers", f"another in frame {int(wrong.argmax())}",
                          "cut the clip there, or fill the gap")
    length = float(np.median(np.linalg.norm(keypoints[:, 9] - keypoints[:, 0], axis=-1)))
    if not HAND_M[0] <= length <= HAND_M[1]:
        raise SourceError(f"{where}, keypoints", f"metres: {HAND_M[0]} to {HAND_M[1]} from wrist to middle knuckle",
                          f"{length:.4g}", "check the unit and the order of the points; " + DOCS)


def _unit(pose: np.ndarray, where: str) -> np.ndarray:
    length = np.linalg.norm(pose[:, 3:], axis=1, keepdims=True)
    if (length < 1e-6).any():
        raise SourceError(f"{where}, object_pose", "quaternions x y z w", f"zeros in frame {int(length.argmin())}", DOCS)
    pose[:, 3:] /= length
    return pose
