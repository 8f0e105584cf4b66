"""Question: what would the frames show if the hands were not there?"""

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
    """holes that are filled at once, as many as memory has room for"""
    window_px: int = 0
    """side of the square that is cut out around a hole; 0: the frame's shorter side, as in training"""
    window_frames: int = 0
    """frames around the target among which the three others are, evenly spread; 0: the whole clip"""
    ddim_steps: int = 200
    """denoising steps, 1 to 500"""
    ddim_eta: float = 1.0
    """share of fresh noise in every step, 0..1"""
    seed: int = 0
    """seed of the noise"""


@dataclass(frozen=True)
class LamaParams(Pretrained):
    """Parameters of `lama`."""

    batch: int = 4
    """holes that are filled at once, as many as memory has room for"""
    window_px: int = 0
    """side of the square that is cut out around a hole, or more; 0: the whole frame"""


@dataclass(frozen=True)
class Filled:
    """A guess for the pixels of the hole; what a backend says of other pixels is ignored."""

    rgb: np.ndarray
    """(t, h, w, 3) uint8"""
    source: np.ndarray
    """(t, h, w) uint8 PixelSource"""
    confidence: np.ndarray
    """(t, h, w) uint8: 255 = seen directly in another frame, 0 = guessed"""


class Inpaint(Protocol[Own]):
    """What every backend of this folder looks like."""

    def __call__(self, frames: Frames, tracks: Tracks, hole: np.ndarray, params: Own) -> Filled:
        """Fill `hole` (t, h, w) bool, which contains every hand pixel of `tracks`.

        Frames need not be consecutive: four frames, seconds apart, are a valid input, and so is one. `params` are those of this
        backend. Pure and deterministic; the inputs are not modified.
        """
        ...
