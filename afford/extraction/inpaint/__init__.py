"""Question: what would the frames show if the hands were not there?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    import numpy as np

    from schemas.masks import Tracks
    from schemas.video import Frames


@dataclass(frozen=True)
class Filled:
    """A guess for the pixels of the hole; what a backend says of other pixels is ignored."""

    rgb: np.ndarray
    """(t, h, w, 3) uint8"""
    source: np.ndarray
    """(t, h, w) uint8 PixelSource"""
    confidence: np.ndarray
    """(t, h, w) uint8: 255 = seen directly in another frame, 0 = guessed"""


class Inpaint(Protocol):
    """What every backend of this folder looks like."""

    def __call__(self, frames: Frames, tracks: Tracks, hole: np.ndarray, params: Any) -> Filled:
        """Fill `hole` (t, h, w) bool, which contains every hand pixel of `tracks`.

        Frames need not be consecutive: four frames, seconds apart, are a valid input, and so is one. `params` is the Params
        of the stage; a backend names the fields that it reads in its own docstring. Pure and deterministic; the inputs are
        not modified.
        """
        ...
