"""Arrays of clips -> what the model sees. Frame i sees the motion that led to it, from frame i - 1; the first sees none."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from afford.rgbd.model.config import Sor3dConfig

MEAN, SPREAD = np.array((0.485, 0.456, 0.406), np.float32), np.array((0.229, 0.224, 0.225), np.float32)
"""of the colours of ImageNet, for encoders that were trained on it"""
STEP = 127.0
"""colours from no motion to full motion"""


class Seen(NamedTuple):
    """One sequence at the size of the model."""

    rgb: np.ndarray
    """(t, h, w, 3) uint8"""
    depth_m: np.ndarray
    """(t, h, w) float32 or float16, 0 = hole or no depth at all"""
    flow: np.ndarray
    """(t - 1, h, w, 3) uint8 colours of motion: in space or on the image, as the model wants it; (0, ...) for none"""
    still: np.ndarray
    """(3,) uint8: what no motion looks like in `flow`"""


class Frames(NamedTuple):
    """n sequences of t frames."""

    appearance: Tensor
    """(n, t, 4, h, w) float32: colours, depth"""
    motion: Tensor
    """(n, t, 3, h, w) float32, about -1..1; 0 is no motion"""

    def to(self, device: str) -> Frames:
        """The same on another device."""
        return Frames(self.appearance.to(device), self.motion.to(device))


def frames(clips: Sequence[Seen], config: Sor3dConfig) -> Frames:
    """Sequences of one length and size. ValueError when a flow does not fit its clip.

    Without torch up to the last line: batches are made in a thread beside the training, whose threads wait for those of torch.
    """
    pairs = [(_appearance(clip, config), _motion(clip, config)) for clip in clips]
    return Frames(*(torch.from_numpy(np.stack(parts)) for parts in zip(*pairs, strict=True)))


def _appearance(clip: Seen, config: Sor3dConfig) -> np.ndarray:
    rgb = (clip.rgb.astype(np.float32) / 255 - MEAN) / SPREAD
    depth = relative(clip.depth_m.astype(np.float32), config.depth_span_m)
    return np.concatenate([rgb.transpose(0, 3, 1, 2), depth[:, None]], 1)


def relative(depth_m: np.ndarray, span_m: float) -> np.ndarray:
    """Depth beyond the median of the first frame, in spans, -1..1; holes are 0, and so is all of a clip without depth."""
    known = depth_m > 0
    middle = np.median(depth_m[0][known[0]]) if known[0].any() else np.median(depth_m[known]) if known.any() else 0.0
    return np.where(known, np.clip((depth_m - middle) / span_m, -1, 1), 0).astype(np.float32)


def _motion(clip: Seen, config: Sor3dConfig) -> np.ndarray:
    """(t, 3, h, w): flow i - 1 at frame i, its sizes raised to a power."""
    steps, height, width = clip.rgb.shape[:3]
    motion = np.zeros((steps, 3, height, width), np.float32)
    if len(clip.flow):
        if clip.flow.shape != (steps - 1, height, width, 3):
            raise ValueError(f"flow: expected {(steps - 1, height, width, 3)} for a clip of {steps} frames, got {clip.flow.shape}")
        colours = (clip.flow.astype(np.float32) - clip.still.astype(np.float32)) / STEP
        motion[1:] = (np.sign(colours) * np.abs(colours) ** np.float32(config.motion_power)).transpose(0, 3, 1, 2)
    return motion
