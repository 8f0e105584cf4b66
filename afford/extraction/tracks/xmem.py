"""Propagate key-frame masks with XMem, as in 2HandedAfforder, forwards and backwards, weighted by nearness to the key frames."""

from __future__ import annotations

from functools import partial

import numpy as np

from afford.extraction.tracks import Propagated, Xmem
from afford.extraction.tracks.two_ways import Pass, propagate_two_ways
from afford.models.xmem import load_model, session, track_frames
from afford.models.xmem_memory import MemorySize

WEIGHTS = "XMem.pth as released, or a folder of `weights import xmem`"
MET = "published size, random weights, 2026-11: 62,185,224 parameters; released names and shapes, read from forks of the code"


def propagate(rgb: np.ndarray, key_index: np.ndarray, key_labels: np.ndarray, count: int, params: Xmem) -> Propagated:
    """Propagate with XMem, see `Propagate`. Between two key frames each pass has its own working and long-term memory."""
    size = MemorySize(params.top_k, params.least_frames, params.most_frames, params.prototypes, params.long_term)
    model = load_model(params.model, params.device, params.dtype)

    def start(prompts: dict[int, np.ndarray]) -> Pass:
        made = session(model, rgb, prompts, params.short_side_px)
        return partial(track_frames, made, every=params.stride_frames, size=size, alone=params.memory_keys == 0)

    return propagate_two_ways(rgb, key_index, key_labels, count, params.memory_keys, start)
