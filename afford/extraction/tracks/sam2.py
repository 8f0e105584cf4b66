"""Propagate key-frame masks with SAM 2 video segmentation, forwards and backwards, weighted by nearness to the key frames."""

from __future__ import annotations

from functools import partial

import numpy as np

from afford.extraction.tracks import Propagated, Sam2
from afford.extraction.tracks.two_ways import Pass, propagate_two_ways
from afford.models.sam2 import load_model, session, track_frames

WEIGHTS = "a Sam2VideoModel: folder of save_pretrained, sam2*_hiera_*.pt, or hub id as facebook/sam2.1-hiera-tiny"
MET = ("published size, random weights, 2026-11: SAM 2.1 large, 8.7 frames/s of two objects on an H200; names and shapes of "
       "all four sizes in sam2 1.1.0")


def propagate(rgb: np.ndarray, key_index: np.ndarray, key_labels: np.ndarray, count: int, params: Sam2) -> Propagated:
    """Propagate with SAM 2, see `Propagate`. Both passes between two key frames share image features."""
    model = load_model(params.model, params.device, params.dtype)

    def start(prompts: dict[int, np.ndarray]) -> Pass:
        return partial(track_frames, model, rgb, prompts, within=session(model, rgb, prompts, max(params.cache_frames, 1)))

    return propagate_two_ways(rgb, key_index, key_labels, count, params.memory_keys, start)
