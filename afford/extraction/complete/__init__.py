"""Amodal completion: the pixels that an object would cover without occlusion. Parameters and interface of the backends."""

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
    """Complete (amodal) masks of one object."""

    masks: np.ndarray
    """(t, h, w) bool. The stage adds the visible pixels and removes pixels that no other mask covers."""
    confidence: np.ndarray
    """(t,) float32 in 0..1"""


class Complete(Protocol[Own]):
    """Interface of a backend of `object_completion`."""

    def __call__(self, frames: Frames, tracks: Tracks, inpainted: Inpainted, index: int, params: Own) -> Completed:
        """Complete the object `tracks.entities[index]` in every frame; a frame without evidence stays empty.

        `params` are the parameters of the backend. Pure and deterministic; the inputs are not modified.
        """
        ...
