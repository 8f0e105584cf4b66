"""Reader of SOR3D-AFF sequences: the files of one sequence -> a clip. SourceError, one sentence, for unusable files."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from afford.common.errors import SourceError
from afford.common.text import natural_key, parse_json
from afford.dataset.sor3d_layout import CAMERA, DEPTH_MM, EXTRAS, GRID, MASK, SPOT, dominant_colour, label_of_colours, parse_name
from afford.rgbd.readers.static_set import decode_picture
from schemas.files import FileRef, FileTree
from schemas.interaction import BACKGROUND, COLOURS_BGR, InteractionClip

SLOTS = 20


def sample_slots(count: int) -> list[int]:
    """Frames of the released code's sampling: indices from 0 for every second of 20 slots, -1 for an empty slot in front.

    Between 21 and 120 frames this is the released code: a step of 1 to 6, ending with the last frame. For up to 20 frames the
    released code takes fewer frames than there are (a step of 6), and beyond 120 it overflows; here all are taken, and the step
    grows. ValueError for no frame.
    """
    if count < 1:
        raise ValueError(f"slots: expected 1 frame at least, got {count}")
    step = 1 if count <= 30 else -(-count // 20) if count <= 40 else max(3, -(-count // 20))
    taken = [count - 1 - step * k for k in range(min(SLOTS, max(1, count // step)))][::-1]
    filled = [-1] * (SLOTS - len(taken)) + taken
    return filled[1::2]


SHRUNK, ROWS, COLUMNS = (640, 360), slice(0, 300), slice(200, 500)
"""The released code resizes 1920 x 1080 to this (width, height) and crops these rows and columns."""
WIDE = (16, 9)
"""aspect ratio, width to height, of such frames: others would be distorted"""
DOCS = "see docs/rgbd/interaction-data.md"
REGISTER = "register colour to the depth grid first, docs/rgbd/interaction-data.md"


@dataclass(frozen=True)
class Rules:
    """Parameters of the reader, see stages/rgbd/interaction_read.py."""

    frames: str
    grid: str
    rate_hz: float
    focal_px: float


def read_clip(files: FileTree, rules: Rules) -> InteractionClip:
    """Read one sequence."""
    if not files.files:
        raise SourceError(files.name, "the files of a sequence", "no such file", DOCS)
    name = parse_name(files.files[0].name)
    base = f"{name.split}/{name.folder}"
    rgb = sorted(files.under(f"{base}/rgb"), key=lambda file: natural_key(file.name))
    if len(rgb) <= EXTRAS:
        raise SourceError(f"{base}/rgb", f"frames and {EXTRAS} files behind them", f"{len(rgb)} files", DOCS)
    frames, extras = rgb[:-EXTRAS], rgb[-EXTRAS:]
    chosen = list(range(len(frames))) if rules.frames == "all" else sample_slots(len(frames))
    raw = _size(frames[-1], rules.grid)
    label = _grid(_label(extras[MASK], raw, name.affordance), rules.grid, cv2.INTER_NEAREST)
    size = label.shape
    shown = np.stack([_frame(frames[k], raw, rules.grid) if k >= 0 else np.zeros((*size, 3), np.uint8) for k in chosen])
    depth = np.stack([_depth(files, base, frames[k], raw, rules.grid) if k >= 0 else np.zeros(size, np.float32) for k in chosen])
    K, rate = _camera(files, base, size, rules)
    return InteractionClip(name.folder, name.split, name.object_type, name.affordance, np.ascontiguousarray(shown[..., ::-1]),
                           depth, K, label, rate, _spots(extras[SPOT], size, rules.grid))  # fmt: skip


def _colour(file: FileRef) -> np.ndarray:
    """Colours (h, w, 3) uint8 BGR."""
    return decode_picture(file, cv2.IMREAD_COLOR, np.uint8, 3)


def _size(last: FileRef, grid: str) -> tuple[int, ...]:
    """Size (h, w) of the frames in their files: that of the last one."""
    height, width = _colour(last).shape[:2]
    if grid == "stcae" and width * WIDE[1] != height * WIDE[0]:
        raise SourceError(last.name, f"a frame of {WIDE[0]} : {WIDE[1]}, as grid='stcae' shrinks", f"{width} x {height} px",
                          "set interaction_read.grid=native")  # fmt: skip
    return height, width


def _like(found: np.ndarray, raw: tuple[int, ...], file: FileRef, what: str, fix: str) -> np.ndarray:
    """Return the picture when it has the size of the frames; SourceError otherwise."""
    height, width = found.shape[:2]
    if (height, width) != raw:
        raise SourceError(file.name, f"{what} of {raw[1]} x {raw[0]} px like the last frame", f"{width} x {height}", fix)
    return found


def _label(file: FileRef, raw: tuple[int, ...], affordance: str) -> np.ndarray:
    """Label (h, w) uint8 on the grid of the file. SourceError where no pixel has the colour of the sequence's affordance."""
    mask = _like(_colour(file), raw, file, "a mask", "write masks on the grid of the frames")
    label = label_of_colours(mask, affordance)
    if (label == BACKGROUND).all():
        raise SourceError(file.name, f"pixels of B, G, R {COLOURS_BGR[affordance]} for {affordance}, the second word of the folder",
                          f"mostly {dominant_colour(mask) or 'black alone'}",
                          "write masks as PNG in exactly that colour")  # fmt: skip
    return label


def _frame(file: FileRef, raw: tuple[int, ...], grid: str) -> np.ndarray:
    """Frame (h, w, 3) uint8 BGR on the output grid."""
    return _grid(_like(_colour(file), raw, file, "a frame", "give frames of one size"), grid, cv2.INTER_LINEAR)


def _depth(files: FileTree, base: str, frame: FileRef, raw: tuple[int, ...], grid: str) -> np.ndarray:
    """Depth (h, w) float32 in metres on the output grid; zeros where the sequence has no depth at all."""
    if not files.under(f"{base}/depth"):
        return _grid(np.zeros(raw, np.float32), grid, cv2.INTER_NEAREST)
    stem = frame.name.rpartition("/")[2].rpartition(".")[0]
    file = files.find(f"{base}/depth/{stem}.png")
    if file is None:
        raise SourceError(f"{base}/depth", f"{stem}.png, as rgb/ has that frame", "nothing", "give every frame its depth, or none")
    found = _like(decode_picture(file, cv2.IMREAD_UNCHANGED, np.uint16, 2), raw, file, "depth", REGISTER)
    return (_grid(found, grid, cv2.INTER_NEAREST) / DEPTH_MM).astype(np.float32)


def _grid(found: np.ndarray, grid: str, how: int) -> np.ndarray:
    if grid == "native":
        return found
    return np.ascontiguousarray(cv2.resize(found, SHRUNK, interpolation=how)[ROWS, COLUMNS])


def _camera(files: FileTree, base: str, size: tuple[int, ...], rules: Rules) -> tuple[np.ndarray, float]:
    """K (3, 3) of the output grid and the frame rate: those of camera.json, else of the nominal colour camera."""
    file = files.find(f"{base}/{CAMERA}")
    scale = rules.focal_px / GRID[0]
    width, height, left, top = size[1], size[0], 0, 0
    if rules.grid == "stcae":
        (width, height), left, top = SHRUNK, COLUMNS.start, ROWS.start
    given = {"fx": scale * width, "fy": scale * width, "cx": (width - 1) / 2 - left, "cy": (height - 1) / 2 - top,
             "rate_hz": rules.rate_hz}  # fmt: skip
    if file is not None:
        record = parse_json(file.path.read_bytes(), file.name)
        given = {key: _number(record, key, file.name) for key in given}
        if rules.grid == "stcae":
            raise SourceError(file.name, "grid='native', as K is given for the files", "grid='stcae'", "read it as it is")
    if min(given["fx"], given["fy"], given["rate_hz"]) <= 0:
        raise SourceError(file.name if file else base, "positive fx, fy and rate_hz", str(given), DOCS)
    K = np.array([[given["fx"], 0, given["cx"]], [0, given["fy"], given["cy"]], [0, 0, 1.0]])
    return K, float(given["rate_hz"])


def _spots(file: FileRef, size: tuple[int, ...], grid: str) -> np.ndarray:
    """Circles (k, 3) float32 x, y, radius on the output grid."""
    record = parse_json(file.path.read_bytes(), file.name)
    if not isinstance(record, dict) or not isinstance(record.get("center"), list):
        raise SourceError(f"{file.name}, center", "a list of circles", type(record).__name__, DOCS)
    found = [[_number(spot, key, file.name) for key in ("x_coord", "y_coord", "radius")] for spot in record["center"]]
    spots = np.array(found, np.float64).reshape(-1, 3)
    if grid == "stcae":
        return np.asarray(spots * (SHRUNK[0] / GRID[0]) - (COLUMNS.start, ROWS.start, 0), np.float32)
    return np.asarray(spots * (size[1] / GRID[0], size[0] / GRID[1], size[1] / GRID[0]), np.float32)


def _number(record: object, key: str, where: str) -> float:
    """Number at a key, or a text of a number (the released code accepts both)."""
    found = record.get(key) if isinstance(record, dict) else None
    try:
        number = float(found) if isinstance(found, (int, float, str)) and not isinstance(found, bool) else math.nan
    except (ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise SourceError(f"{where}, {key}", "a number", repr(found), DOCS)
    return number
