"""Question: which entity does every pixel of every frame belong to, when that is known in a few key frames?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    import numpy as np

BACKGROUND = 0
UNKNOWN = -1


@dataclass(frozen=True)
class Propagated:
    """One label per pixel, so that entities never overlap."""

    labels: np.ndarray
    """(t, h, w) int16: 0 background, i + 1 entity i. Equal to the key labels at key frames, their unknown pixels apart."""
    confidence: np.ndarray
    """(n, t) float32 in 0..1: trust in the mask of entity i in frame t; 0 where it has none, 1 at key frames."""


class Propagate(Protocol):
    """What every backend of this folder looks like."""

    def __call__(self, rgb: np.ndarray, key_index: np.ndarray, key_labels: np.ndarray, count: int, params: Any) -> Propagated:
        """Spread the labels of key frames over a run of consecutive frames.

        rgb: (t, h, w, 3) uint8, consecutive in time. key_index: (k,) ascending positions of the key frames in `rgb`, k >= 1.
        key_labels: (k, h, w) int16: 0 background, i + 1 entity i of `count`, -1 not known. An entity that a key frame
        does not show is out of sight there. Frames before the first and after the last key frame are reached from that
        key frame alone. `params` is the Params of the stage; a backend names the fields that it reads in its own docstring.
        Pure and deterministic; the inputs are not modified.
        """
        ...
