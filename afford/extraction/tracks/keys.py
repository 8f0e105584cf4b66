"""Key frames of a clip at working size: every annotation as a mask, at its position among the frames."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from afford.extraction.sources.polygons import rasterise
from schemas.video import Annotation, Clip, Frames


@dataclass(frozen=True)
class Key:
    """One annotated frame."""

    at: int
    """position in `Frames.frame`"""
    annotations: tuple[Annotation, ...]
    masks: np.ndarray
    """(a, h, w) bool, one per annotation"""


def read_keys(clip: Clip, frames: Frames, dense: bool) -> list[Key]:
    """Annotated frames that were decoded, by frame; `dense` asks for the ready-made ones too. ValueError when none is left."""
    height_px, width_px = frames.rgb.shape[1:3]
    position = {int(number): i for i, number in enumerate(frames.frame)}
    keys = []
    for key in clip.key_frames:
        if key.frame not in position or (key.dense and not dense):
            continue
        masks = [rasterise(a, key.width_px, key.height_px, width_px, height_px) for a in key.annotations]
        stack = np.stack(masks) if masks else np.zeros((0, height_px, width_px), bool)
        keys.append(Key(position[key.frame], key.annotations, stack))
    if not keys:
        kind = "key frame" if dense else "sparse key frame"
        raise ValueError(f"clip {clip.clip_id}: expected a {kind} among its {len(frames.frame)} decoded frames, got none")
    return keys


def runs(frame: np.ndarray, max_step: int) -> list[slice]:
    """Stretches of `frame` (t,) whose neighbours are at most `max_step` numbers apart: motion is never chained across a gap."""
    cuts = [0, *(np.flatnonzero(np.diff(frame) > max_step) + 1).tolist(), len(frame)]
    return [slice(a, b) for a, b in pairwise(cuts)]
