"""Depth pictures and pinhole cameras from files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np

from afford.common.bounded import check_image, load_npy, not_an_image, reason
from afford.common.errors import SourceError
from afford.common.strict_json import parse_json

PNG_M = 0.001
"""a depth PNG counts millimetres"""
FARTHEST_M = 20.0
"""depths beyond are no depths of a thing that a hand grasps: a file in millimetres that should be in metres"""


def read_depth(path: Path) -> np.ndarray:
    """(h, w) float32 metres, 0 where nothing was measured, of a 16-bit PNG in millimetres or a .npy in metres."""
    expected, fix = "a depth picture: PNG of 16 bits in millimetres, or .npy (h, w) in metres", "convert it"
    try:
        found = load_npy(path, str(path)) if path.suffix == ".npy" else read_png(path)
    except OSError as error:
        raise SourceError(str(path), expected, reason(error), "check the path and the format") from error
    if found.ndim != 2 or not (found.dtype == np.uint16 if path.suffix != ".npy" else found.dtype.kind == "f"):
        raise SourceError(str(path), expected, f"{found.dtype} {found.shape}", fix)
    depth = (found * PNG_M if found.dtype == np.uint16 else found).astype(np.float32)
    depth = np.where(np.isfinite(depth) & (depth > 0), depth, 0.0).astype(np.float32)
    known = depth[depth > 0]
    if not len(known) or np.median(known) > FARTHEST_M:
        got = f"a median of {np.median(known):g} m" if len(known) else "no pixel with depth"
        raise SourceError(str(path), f"depths of at most {FARTHEST_M:g} m", got, fix)
    return depth


def read_png(path: Path) -> np.ndarray:
    data = path.read_bytes()
    check_image(data, str(path))
    try:
        found = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise not_an_image(str(path), len(data)) from error
    if found is None:
        raise not_an_image(str(path), len(data))
    return found


def read_json(path: Path, what: str) -> Any:
    try:
        return parse_json(path.read_bytes(), str(path))
    except OSError as error:
        raise SourceError(str(path), what, reason(error), "check the path") from error


def read_intrinsics(path: Path) -> np.ndarray:
    """Intrinsic matrix K (3, 3), px, of a camera file in JSON. SourceError when the file holds no such matrix."""
    content = read_json(path, "a camera (JSON)")
    expected = 'fx, fy, cx, cy, or "K" with three rows of three numbers'
    if isinstance(content, dict) and {"fx", "fy", "cx", "cy"} <= set(content):
        content = {"K": [[content["fx"], 0.0, content["cx"]], [0.0, content["fy"], content["cy"]], [0.0, 0.0, 1.0]]}
    K = finite_array(content.get("K") if isinstance(content, dict) else content, (3, 3))
    if K is None or not (K[0, 0] > 0 and K[1, 1] > 0 and np.array_equal(K[2], [0, 0, 1]) and K[1, 0] == 0):
        raise SourceError(str(path), expected, "something else", "write the pinhole matrix in pixels")
    return K


def finite_array(found: Any, shape: tuple[int, ...]) -> np.ndarray | None:
    """The array, None when it is not one of finite numbers of this shape; -1 stands for any size."""
    try:
        out = np.array(found, np.float64)
    except (TypeError, ValueError, OverflowError):
        return None
    fits = out.ndim == len(shape) and all(want in (-1, got) for want, got in zip(shape, out.shape, strict=True))
    return out if fits and np.isfinite(out).all() else None
