"""Inpaint with VIDM, a diffusion model over four far-apart frames, as in 2HandedAfforder.

Needs its published checkpoint; slow on a CPU. The input of the network are crops of 256 x 256 around the holes, not scaled where a
hole fits into `window_px`. Only the pixels of the hole are pasted back.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from afford.common.masks import dilate
from afford.extraction.inpaint import Filled, VidmParams
from afford.extraction.inpaint.vidm_model import Vidm, ddim, fill, load
from afford.extraction.inpaint.windows import Window, chunks, cut, cut_hole, paste, side_of, windows
from afford.models.loading import device_of, dtype_of
from schemas.masks import Tracks
from schemas.video import Frames, PixelSource

WEIGHTS = "a folder or checkpoint of VIDM, with the names that were published (docs/extraction/inpainting.md)"
MET = "published size, random weights, 2026-11: 1.12 s a frame of 50 steps on an H200; parts computed as in the published code"
GROWN_PX = 3
"""dilation of a hole in the input of the network: the paper's second dilation, by 7 x 7 at 256 x 256"""
CONFIDENCE = 128
"""confidence of a sample of a generative model that is conditioned on other frames"""


class HoleWindow(NamedTuple):
    """The hole of one frame inside one window."""

    t: int
    number: int
    window: Window


def inpaint(frames: Frames, tracks: Tracks, hole: np.ndarray, params: VidmParams) -> Filled:
    """Inpaint with VIDM, see `Inpaint`. Frames without a hole are copied; without any hole no model is loaded."""
    ddim(params.ddim_steps)
    side = side_of(params.window_px, min(hole.shape[1:]))
    jobs = [HoleWindow(t, number, window) for t in range(len(hole)) for number, window in enumerate(windows(hole[t], side))]
    out = frames.rgb.copy()
    if jobs:
        model = load(params.model, device_of(params.device), dtype_of(params.dtype))
        left = hole.copy()
        for batch in chunks(jobs, params.batch):
            for job, image in zip(batch, _fill_batch(model, frames, hole, batch, params), strict=True):
                paste(out[job.t], job.window, image, left[job.t])
                left[job.t][job.window.inside(hole.shape[1:])] = False
    source = np.where(hole, PixelSource.BACKGROUND, PixelSource.ORIGINAL).astype(np.uint8)
    return Filled(out, source, np.where(hole, CONFIDENCE, 255).astype(np.uint8))


def context_frames(t: int, length: int, count: int, within: int = 0) -> list[int]:
    """Choose the positions of `count` frames, the context in order and the target `t` last.

    The frames are equally spaced in the `within` frames around the target (0: in all).
    """
    stretch = min(within or length, length)
    start = min(max(t - stretch // 2, 0), length - stretch)
    return [*sorted(start + (t - start + k * stretch // count) % stretch for k in range(1, count)), t]


def _fill_batch(model: Vidm, frames: Frames, hole: np.ndarray, jobs: Sequence[HoleWindow], params: VidmParams) -> np.ndarray:
    """Fill the windows of a batch, (b, s, s, 3) uint8."""
    size, count = model.config.size_px, model.config.frames
    groups = [context_frames(job.t, len(hole), count, params.window_frames) for job in jobs]
    pairs = list(zip(jobs, groups, strict=True))
    rgb = np.stack([[cut(frames.rgb[i], job.window, size) for i in group] for job, group in pairs])
    holes = np.stack([[dilate(cut_hole(hole[i], job.window, size), GROWN_PX) for i in group] for job, group in pairs])
    seeds = [_seed(params.seed, int(frames.frame[job.t]), job.number) for job in jobs]
    return fill(model, rgb, holes, steps=params.ddim_steps, eta=params.ddim_eta, seeds=seeds)


def _seed(*of: int) -> int:
    """Derive the seed of a window of a frame, independent of the rest of the batch."""
    return int(np.random.SeedSequence(of).generate_state(1, np.uint64)[0] >> np.uint64(1))
