"""Question: which pixels would an object cover if nothing stood before it?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    import numpy as np

    from schemas.masks import Tracks
    from schemas.video import Frames, Inpainted


@dataclass(frozen=True)
class Completed:
    """The complete shape of one object."""

    masks: np.ndarray
    """(t, h, w) bool. The stage adds the visible pixels and removes what nothing could hide."""
    confidence: np.ndarray
    """(t,) float32 in 0..1"""


class Complete(Protocol):
    """What every backend of this folder looks like."""

    def __call__(self, frames: Frames, tracks: Tracks, inpainted: Inpainted, index: int, params: Any) -> Completed:
        """Complete the object `tracks.entities[index]` in every frame; empty where nothing of it is known.

        `params` is the Params of the stage; a backend names the fields that it reads in its own docstring. Pure and
        deterministic; the inputs are not modified.
        """
        ...
