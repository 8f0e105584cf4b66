"""LaMa, a feed-forward network that fills each frame alone, in one pass. Needs its published weights; a CPU will do.

Works at the frame's own size, mirrored up to multiples of 8 at the bottom and at the right; nothing is scaled.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np
import torch

from afford.extraction.inpaint import Filled, LamaParams
from afford.extraction.inpaint.networks.lama_files import load
from afford.extraction.inpaint.networks.lama_generator import Generator
from afford.extraction.inpaint.windows import chunks, side_of, windows
from afford.models.loading import device_of, dtype_of
from schemas.masks import Tracks
from schemas.video import Frames, PixelSource

WEIGHTS = "LaMa's published checkpoint, a TorchScript file of it, or safetensors (docs/extraction/inpainting.md)"


class Job(NamedTuple):
    """One frame's hole in one part of it, (rows, columns)."""

    t: int
    area: tuple[slice, slice]


def inpaint(frames: Frames, tracks: Tracks, hole: np.ndarray, params: LamaParams) -> Filled:
    """See `Inpaint`. Confidence is 0: everything is guessed. With no hole at all no model is loaded."""
    side = side_of(params.window_px, 0)
    jobs = [Job(t, area) for t in range(len(hole)) for area in _areas(hole[t], side)]
    out = frames.rgb.copy()
    if jobs:
        model = load(params.model, device_of(params.device), dtype_of(params.dtype))
        for _, same in groupby(sorted(jobs, key=_shape), _shape):
            for batch in chunks(list(same), params.batch):
                _paint(model, frames.rgb, hole, batch, out)
    source = np.where(hole, PixelSource.SPATIAL, PixelSource.ORIGINAL).astype(np.uint8)
    return Filled(out, source, np.zeros(hole.shape, np.uint8))


@torch.inference_mode()
def fill(model: Generator, rgb: np.ndarray, holes: np.ndarray) -> np.ndarray:
    """(b, h, w, 3) uint8 pictures and (b, h, w) bool holes -> (b, h, w, 3) uint8; pixels outside the holes are the model's own."""
    first = next(model.parameters())
    height, width = rgb.shape[1:3]
    known = np.concatenate([np.where(holes[..., None], 0, rgb) / np.float32(255), holes[..., None].astype(np.float32)], -1)
    more = [(0, -length % model.config.multiple_px) for length in (height, width)]
    padded = np.pad(known, [(0, 0), *more, (0, 0)], "symmetric")
    found = model(torch.from_numpy(padded).permute(0, 3, 1, 2).to(first))[:, :, :height, :width]
    return (found.float().clamp(0, 1) * 255).round().byte().permute(0, 2, 3, 1).cpu().numpy()


def _areas(hole: np.ndarray, side: int) -> list[tuple[slice, slice]]:
    if side:
        return [window.inside(hole.shape) for window in windows(hole, side)]
    return [(slice(0, hole.shape[0]), slice(0, hole.shape[1]))] if hole.any() else []


def _shape(job: Job) -> tuple[int, int]:
    rows, columns = job.area
    return rows.stop - rows.start, columns.stop - columns.start


def _paint(model: Generator, rgb: np.ndarray, hole: np.ndarray, jobs: Sequence[Job], out: np.ndarray) -> None:
    answers = fill(model, np.stack([rgb[job.t][job.area] for job in jobs]), np.stack([hole[job.t][job.area] for job in jobs]))
    for job, answer in zip(jobs, answers, strict=True):
        inside = hole[job.t][job.area]
        out[job.t][job.area][inside] = answer[inside]
