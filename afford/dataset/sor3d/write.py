"""A film -> the files of a sequence, as SOR3D-AFF lays them out; depth and camera beside them are an extension of ours."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np

from afford.dataset.sor3d.colours import paint
from afford.dataset.sor3d.names import CAMERA, DEPTH_MM, VIEWS
from schemas.interaction import InteractionClip

GRID = (1920, 1080)
"""Hot spots are given on the grid of the Kinect's colour camera, in whole pixels."""


def write(clip: InteractionClip, root: Path) -> Path:
    """Write `<split>/<name>/`: rgb/NNNN.png with the four files behind them, depth/NNNN.png (16 bit, mm, 0 = hole), camera.json.
    ValueError when a depth does not fit into 16 bits of millimetres.
    """
    folder = root / clip.split / clip.name
    for name in ("rgb", "depth"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    if clip.depth_m.max(initial=0) * DEPTH_MM > np.iinfo(np.uint16).max:
        raise ValueError(f"{clip.name}, depth_m: expected 65.535 m at most, got {float(clip.depth_m.max()):.3f} m")
    for number, (rgb, depth) in enumerate(zip(clip.rgb, clip.depth_m, strict=True), 1):
        _png(folder / "rgb" / f"{number:04d}.png", rgb[..., ::-1])
        _png(folder / "depth" / f"{number:04d}.png", np.round(depth * DEPTH_MM).astype(np.uint16))
    mask = paint(clip.label)
    _png(folder / "rgb" / "target_1_mask.png", mask)
    _png(folder / "rgb" / "target_2_frame.png", clip.rgb[-1][..., ::-1])
    _png(folder / "rgb" / "target_3_both.png", np.where(mask.any(axis=-1, keepdims=True), mask, clip.rgb[-1][..., ::-1]))
    _json(folder / "rgb" / "target_4_hotspot.json", {"center": _spots(clip)})
    K = clip.K
    _json(folder / CAMERA, {"fx": K[0, 0], "fy": K[1, 1], "cx": K[0, 2], "cy": K[1, 2], "rate_hz": clip.rate_hz})
    return folder


def write_views(views: dict[str, int], root: Path) -> Path:
    """The file that says which of three cameras saw a person, `SubjectN<tab>1..3` a line, as in the released code."""
    path = root / VIEWS
    path.write_text("".join(f"{subject}\t{view}\n" for subject, view in views.items()), encoding="utf-8", newline="\n")
    return path


def _spots(clip: InteractionClip) -> list[dict[str, int]]:
    height, width = clip.label.shape
    across, down = GRID[0] / width, GRID[1] / height
    return [{"x_coord": round(float(x) * across), "y_coord": round(float(y) * down), "radius": round(float(r) * across)}
            for x, y, r in clip.hotspot]  # fmt: skip


def _png(path: Path, picture: np.ndarray) -> None:
    done, data = cv2.imencode(".png", np.ascontiguousarray(picture), [cv2.IMWRITE_PNG_COMPRESSION, 3])
    if not done:
        raise ValueError(f"{path.name}: OpenCV cannot write {picture.dtype} {picture.shape} as PNG")
    path.write_bytes(data.tobytes())


def _json(path: Path, value: object) -> None:
    path.write_text(json.dumps(value), encoding="utf-8", newline="\n")
