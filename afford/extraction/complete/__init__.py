"""Question: which pixels would an object cover if nothing stood before it?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from afford.common.registry import Own
from afford.models.weights import Pretrained

if TYPE_CHECKING:
    import numpy as np

    from schemas.masks import Tracks
    from schemas.video import Frames, Inpainted


@dataclass(frozen=True)
class Sam2(Pretrained):
    """Parameters of `sam2`."""

    model: str = ""
    """local folder or hub id of a Sam2VideoModel, or sam2*_hiera_*.pt"""


@dataclass(frozen=True)
class Completed:
    """The complete shape of one object."""

    masks: np.ndarray
    """(t, h, w) bool. The stage adds the visible pixels and removes what nothing could hide."""
    confidence: np.ndarray
    """(t,) float32 in 0..1"""


class Complete(Protocol[Own]):
    """What every backend of this folder looks like."""

    def __call__(self, frames: Frames, tracks: Tracks, inpainted: Inpainted, index: int, params: Own) -> Completed:
        """Complete the object `tracks.entities[index]` in every frame; empty where nothing of it is known.

        `params` are those of this backend. Pure and deterministic; the inputs are not modified.
        """
        ...
