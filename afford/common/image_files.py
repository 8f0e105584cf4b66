"""Image files: decode RGB and depth images and camera intrinsics, encode JPEG and PNG.

Image sizes are checked before anything is decoded (bounded.py). Errors are SourceError, one sentence.
"""

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
    """Input image of a model."""

    name: str
    """name in messages and in the output, without suffix: `tea/kettle`, `clip/frame_0000011`"""
    source: str
    """file of the image, as the user wrote it"""
    rgb: np.ndarray
    """(h, w, 3) uint8"""
    frame: int | None = None
    """number of the frame in its video, from 1"""
    time_s: float | None = None
    """time of the frame in its video"""


def read_image(path: Path) -> np.ndarray:
    """Read an image file as upright RGB (h, w, 3) uint8. SourceError for any other file."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise SourceError(str(path), "an image", error.strerror or str(error), "check the path") from error
    return decode_image(data, str(path))


def decode_image(data: bytes, name: str, max_pixels: int = MAX_PIXELS) -> np.ndarray:
    """Decode an image to upright RGB (h, w, 3) uint8.

    The EXIF orientation is applied and transparency is dropped. Raises SourceError (TooLargeError) for data that cannot be decoded.
    """
    check_image(data, name, max_pixels)
    try:
        bgr = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR_BGR)
    except cv2.error as error:
        raise not_an_image(name, len(data)) from error
    if bgr is None:
        raise not_an_image(name, len(data))
    return cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)


def encode_jpeg(rgb: np.ndarray, quality: int) -> np.ndarray:
    """Encode (h, w, 3) uint8 RGB as the bytes (b,) uint8 of a JPEG; quality 0..100."""
    return _file(".jpg", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), (cv2.IMWRITE_JPEG_QUALITY, quality))


def encode_png(picture: np.ndarray, options: tuple[int, ...] = ()) -> np.ndarray:
    """Encode (h, w) grey, (h, w, 3) BGR or (h, w, 4) BGRA uint8 as the bytes (b,) uint8 of a PNG.

    Channel order and `options` are those of OpenCV.
    """
    return _file(".png", picture, options)


def _file(kind: str, picture: np.ndarray, options: tuple[int, ...]) -> np.ndarray:
    done, data = cv2.imencode(kind, picture, options)
    if not done:
        raise ValueError(f"cannot encode a picture of shape {picture.shape} as {kind}")
    return np.asarray(data).reshape(-1)


JPEG_QUALITY = 90
PNG = (cv2.IMWRITE_PNG_COMPRESSION, 2, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_NONE)
"""no filter: five times as fast as libpng's default, and as small for flat images"""
OPACITY = 150


def jpeg(rgb: np.ndarray) -> bytes:
    """Encode (h, w, 3) uint8 sRGB as JPEG."""
    return encode_jpeg(rgb, JPEG_QUALITY).tobytes()


def mask_png(mask: np.ndarray) -> bytes:
    """Encode (h, w) bool as a PNG of 0 and 255, which any viewer shows."""
    return encode_png(mask.view(np.uint8) * np.uint8(255), PNG).tobytes()


def grey_png(values: np.ndarray) -> bytes:
    """Encode (h, w) uint8 as PNG."""
    return encode_png(values, PNG).tobytes()


def colour_png(labels: np.ndarray, palette: Palette) -> bytes:
    """Encode (h, w) uint8 labels as a PNG in the colours of the palette."""
    return encode_png(_painted(labels, [(*colour, 255) for colour in palette])[..., :3], PNG).tobytes()


def overlay_png(masks: np.ndarray, palette: Palette) -> bytes:
    """Encode (n, h, w) bool masks as a transparent PNG; a later mask covers an earlier one."""
    labels = np.zeros(masks.shape[1:], np.uint8)
    for n, mask in enumerate(masks, 1):
        np.copyto(labels, np.uint8(n), where=mask)
    return encode_png(_painted(labels, [(0, 0, 0, 0), *((*colour, OPACITY) for colour in palette)]), PNG).tobytes()


def _painted(labels: np.ndarray, rgba: Sequence[tuple[int, ...]]) -> np.ndarray:
    """Colour labels: (h, w, 4) uint8 in OpenCV's order blue, green, red, alpha."""
    words = np.array(rgba, np.uint8)[:, [2, 1, 0, 3]].copy().view(np.uint32).reshape(-1)
    return np.take(words, labels).view(np.uint8).reshape(*labels.shape, 4)


PNG_M = 0.001
"""metres per unit of a depth PNG"""
FARTHEST_M = 20.0
"""largest plausible median depth of a tabletop scene; larger values mean millimetres in a file of metres"""


def read_depth(path: Path) -> np.ndarray:
    """Read a depth image: a 16-bit PNG in millimetres or a .npy in metres.

    Returns (h, w) float32 metres, 0 for pixels without a measurement.
    """
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
    """Decode a PNG with its own channels and bit depth. SourceError for any other file."""
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
    """Read a JSON file; `what` describes its content in the SourceError for an unreadable one."""
    try:
        return parse_json(path.read_bytes(), str(path))
    except OSError as error:
        raise SourceError(str(path), what, reason(error), "check the path") from error


def read_intrinsics(path: Path) -> np.ndarray:
    """Read the intrinsic matrix K (3, 3), px, from a camera file in JSON. SourceError for any other content."""
    content = read_json(path, "a camera (JSON)")
    expected = 'fx, fy, cx, cy, or "K" with three rows of three numbers'
    if isinstance(content, dict) and {"fx", "fy", "cx", "cy"} <= set(content):
        content = {"K": [[content["fx"], 0.0, content["cx"]], [0.0, content["fy"], content["cy"]], [0.0, 0.0, 1.0]]}
    K = finite_array(content.get("K") if isinstance(content, dict) else content, (3, 3))
    if K is None or not (K[0, 0] > 0 and K[1, 1] > 0 and np.array_equal(K[2], [0, 0, 1]) and K[1, 0] == 0):
        raise SourceError(str(path), expected, "something else", "write the pinhole matrix in pixels")
    return K


def finite_array(found: Any, shape: tuple[int, ...]) -> np.ndarray | None:
    """Convert to a float64 array; None unless it is finite and has this shape, in which -1 matches any size."""
    try:
        out = np.array(found, np.float64)
    except (TypeError, ValueError, OverflowError):
        return None
    fits = out.ndim == len(shape) and all(want in (-1, got) for want, got in zip(shape, out.shape, strict=True))
    return out if fits and np.isfinite(out).all() else None
