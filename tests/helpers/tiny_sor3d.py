"""A tiny random model of RGB-D sequences, and a sequence on disk to ask it about."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import av
import cv2
import numpy as np

from afford.rgbd.model import checkpoint
from afford.rgbd.model.config import Sor3dConfig, row
from afford.rgbd.model.model import build
from afford.rgbd.model.model_inputs import ModelInput

SIZE = 32
CONFIG = Sor3dConfig(widths=(4, 4, 4, 8), size_px=SIZE)


def write_model(folder: Path, row_name: str = "rgbd_attention_flow3d", seed: int = 0) -> Path:
    """Random weights, larger than new ones, so that every input has an effect."""
    model = build(row(replace(CONFIG), row_name), seed)
    checkpoint.save_model(model, folder)
    return folder


def frames(count: int = 4, height: int = 40, width: int = 56) -> tuple[np.ndarray, np.ndarray]:
    """rgb (t, h, w, 3) uint8 and depth (t, h, w) float32 m: a bright square that slides over a wall with a pattern."""
    y, x = np.mgrid[:height, :width]
    wall = np.dstack([60 + 8 * (x // 6 % 4), 70 + 9 * (y // 5 % 4), 80 + 7 * ((x + y) // 7 % 3)]).astype(np.uint8)
    rgb, depth = np.tile(wall, (count, 1, 1, 1)), np.full((count, height, width), 1.0, np.float32)
    for t in range(count):
        rgb[t, 12:26, 14 + 2 * t : 28 + 2 * t] = (220, 200, 40)
        depth[t, 12:26, 14 + 2 * t : 28 + 2 * t] = 0.8
    return rgb, depth


def last_frame(seen: ModelInput) -> ModelInput:
    """Last frame as a picture without motion."""
    return ModelInput(seen.rgb[-1:], seen.depth_m[-1:], seen.flow[:0], seen.still)


def write_frames(root: Path, count: int = 4) -> Path:
    """rgb/0001.png ..., depth/0001.png ... as SOR3D-AFF's layout has them, with a mask that is no frame."""
    rgb, depth = frames(count)
    for name in ("rgb", "depth"):
        (root / name).mkdir(parents=True)
    for n in range(count):
        cv2.imwrite(str(root / "rgb" / f"{n + 1:04d}.png"), rgb[n, ..., ::-1])
        cv2.imwrite(str(root / "depth" / f"{n + 1:04d}.png"), (1000 * depth[n]).round().astype(np.uint16))
    cv2.imwrite(str(root / "rgb" / "target_1_mask.png"), np.zeros((8, 8, 3), np.uint8))
    return root


def write_video(path: Path, count: int = 23, rate: int = 20) -> Path:
    """The square, as a video."""
    rgb, _ = frames(count, 40, 96)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=rate)
        stream.width, stream.height, stream.pix_fmt = 96, 40, "yuv420p"
        for image in rgb:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24")))
        container.mux(stream.encode())
    return path
