"""Inpainting of hands: parameters and interface of the backends."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from afford.common.registry import Own
from afford.models.weights import Pretrained

if TYPE_CHECKING:
    import numpy as np

    from schemas.masks import Tracks
    from schemas.video import Frames


@dataclass(frozen=True)
class VidmParams(Pretrained):
    """Parameters of `vidm`."""

    batch: int = 4
    """holes per forward pass; limited by memory"""
    window_px: int = 0
    """side of the square crop around a hole; 0: the shorter side of the frame, as in training"""
    window_frames: int = 0
    """range of frames around the target from which the three context frames are evenly sampled; 0: the whole clip"""
    ddim_steps: int = 200
    """denoising steps, 1 to 500"""
    ddim_eta: float = 1.0
    """share of new noise in every step, 0..1"""
    seed: int = 0
    """seed of the noise"""


@dataclass(frozen=True)
class LamaParams(Pretrained):
    """Parameters of `lama`."""

    batch: int = 4
    """holes per forward pass; limited by memory"""
    window_px: int = 0
    """least side of the square crop around a hole; 0: the whole frame"""


@dataclass(frozen=True)
class Filled:
    """Filled pixels of the hole; the stage ignores all other pixels."""

    rgb: np.ndarray
    """(t, h, w, 3) uint8"""
    source: np.ndarray
    """(t, h, w) uint8 PixelSource"""
    confidence: np.ndarray
    """(t, h, w) uint8: 255 = observed in another frame, 0 = guessed"""


class Inpaint(Protocol[Own]):
    """Interface of a backend of `hand_inpaint`."""

    def __call__(self, frames: Frames, tracks: Tracks, hole: np.ndarray, params: Own) -> Filled:
        """Fill `hole` (t, h, w) bool, which contains every hand pixel of `tracks`.

        Frames need not be consecutive: four frames, seconds apart, are a valid input, and so is one. `params` are the parameters
        of the backend. Pure and deterministic; the inputs are not modified.
        """
        ...
