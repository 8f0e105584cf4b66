"""Bytes -> a picture: upright RGB, or one sentence about why not. The size is read before anything is decoded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from afford.common.bounded import MAX_PIXELS, check_image, load_npy, not_an_image, reason
from afford.common.errors import SourceError
from afford.common.palette import Palette
from afford.common.text import parse_json


@dataclass(frozen=True)
class Picture:
    """One image that a model can be asked about."""

    name: str
    """what it is called in every message and in the output, without suffix: `tea/kettle`, `clip/frame_0000011`"""
    source: str
    """the file that it comes from, as the user named it"""
    rgb: np.ndarray
    """(h, w, 3) uint8"""
    frame: int | None = None
    """number of the frame in its video, from 1"""
    time_s: float | None = None
    """time of the frame in its video"""


def read_image(path: Path) -> np.ndarray:
    """(h, w, 3) uint8 RGB, upright. SourceError when the file is no image that can be read."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise SourceError(str(path), "an image", error.strerror or str(error), "check the path") from error
    return decode_image(data, str(path))


def decode_image(data: bytes, name: str, max_pixels: int = MAX_PIXELS) -> np.ndarray:
    """(h, w, 3) uint8 RGB, turned as EXIF asks; transparency is dropped. SourceError (TooLargeError) when it cannot be had."""
    check_image(data, name, max_pixels)
    try:
        bgr = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR_BGR)
    except cv2.error as error:
        raise not_an_image(name, len(data)) from error
    if bgr is None:
        raise not_an_image(name, len(data))
    return cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)


def encode_jpeg(rgb: np.ndarray, quality: int) -> np.ndarray:
    """(h, w, 3) uint8 RGB -> (b,) uint8, the file; quality 0..100."""
    return _file(".jpg", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), (cv2.IMWRITE_JPEG_QUALITY, quality))


def encode_png(picture: np.ndarray, options: tuple[int, ...] = ()) -> np.ndarray:
    """(h, w) grey, (h, w, 3) BGR or (h, w, 4) BGRA uint8, in the order of OpenCV, whose options these are -> (b,) uint8."""
    return _file(".png", picture, options)


def _file(kind: str, picture: np.ndarray, options: tuple[int, ...]) -> np.ndarray:
    done, data = cv2.imencode(kind, picture, options)
    if not done:
        raise ValueError(f"cannot encode a picture of shape {picture.shape} as {kind}")
    return np.asarray(data).reshape(-1)


JPEG_QUALITY = 90
PNG = (cv2.IMWRITE_PNG_COMPRESSION, 2, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_NONE)
"""unfiltered: five times as fast as libpng's choice, and as small for flat pictures"""
OPACITY = 150


def jpeg(rgb: np.ndarray) -> bytes:
    """JPEG of (h, w, 3) uint8 sRGB."""
    return encode_jpeg(rgb, JPEG_QUALITY).tobytes()


def mask_png(mask: np.ndarray) -> bytes:
    """PNG of (h, w) bool, 0 and 255, so that any viewer shows it."""
    return encode_png(mask.view(np.uint8) * np.uint8(255), PNG).tobytes()


def grey_png(values: np.ndarray) -> bytes:
    """PNG of (h, w) uint8."""
    return encode_png(values, PNG).tobytes()


def colour_png(labels: np.ndarray, palette: Palette) -> bytes:
    """PNG of (h, w) uint8 labels, each painted in its colour of the palette."""
    return encode_png(_painted(labels, [(*colour, 255) for colour in palette])[..., :3], PNG).tobytes()


def overlay_png(masks: np.ndarray, palette: Palette) -> bytes:
    """Transparent PNG of (n, h, w) bool masks; a later mask lies over an earlier one."""
    labels = np.zeros(masks.shape[1:], np.uint8)
    for n, mask in enumerate(masks, 1):
        np.copyto(labels, np.uint8(n), where=mask)
    return encode_png(_painted(labels, [(0, 0, 0, 0), *((*colour, OPACITY) for colour in palette)]), PNG).tobytes()


def _painted(labels: np.ndarray, rgba: Sequence[tuple[int, ...]]) -> np.ndarray:
    """(h, w, 4) uint8 in the order that OpenCV writes: blue, green, red, alpha."""
    words = np.array(rgba, np.uint8)[:, [2, 1, 0, 3]].copy().view(np.uint32).reshape(-1)
    return np.take(words, labels).view(np.uint8).reshape(*labels.shape, 4)


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
