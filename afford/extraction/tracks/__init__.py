"""Mask tracks of hands and objects: link entities, propagate, find contact."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from afford.common.registry import Own
from afford.models.weights import Pretrained

if TYPE_CHECKING:
    import numpy as np


@dataclass(frozen=True)
class Tracking:
    """Parameters of tracks, however labels spread."""

    radius: int = 0
    """masks farther than this from their key frame are dropped, frames; 0 = full length (released code: 10)"""
    max_step_frames: int = 1
    """frames whose numbers differ by more are no neighbours: nothing is propagated between them"""
    keep_untouched: bool = False
    """also keep annotated objects that no hand touches in any key frame"""
    link_min_iou: float = 0.1
    """overlap from which a same-name object is the one of the key frame before"""
    contact_reach_px: int = 4
    """a hand dilated by this much touches what it overlaps; used where the source does not tell contact"""


BACKGROUND = 0
UNKNOWN = -1


@dataclass(frozen=True)
class Flow:
    """Parameters of `flow`."""

    search_px: int = 1
    """how far around a supposed motion patches are searched; 2 is a little better and twice as slow"""
    band_px: int = 4
    """pixels this close to an outline are decided by patches"""


@dataclass(frozen=True)
class Sam2(Pretrained):
    """Parameters of `sam2`."""

    model: str = ""
    """local folder or hub id of a Sam2VideoModel, or sam2*_hiera_*.pt"""
    memory_keys: int = 2
    """key frames on each side of a gap that the model remembers"""
    cache_frames: int = 16
    """frames whose image features are kept for the way back; about 0.1 GB each at the published sizes"""


@dataclass(frozen=True)
class Propagated:
    """One label per pixel, so that entities never overlap."""

    labels: np.ndarray
    """(t, h, w) int16: 0 background, i + 1 entity i. Equal to the key labels at key frames, their unknown pixels apart."""
    confidence: np.ndarray
    """(n, t) float32 in 0..1: trust in the mask of entity i in frame t; 0 where it has none, 1 at key frames."""


class Propagate(Protocol[Own]):
    """What every backend of this folder looks like."""

    def __call__(self, rgb: np.ndarray, key_index: np.ndarray, key_labels: np.ndarray, count: int, params: Own) -> Propagated:
        """Spread the labels of key frames over a run of consecutive frames.

        rgb: (t, h, w, 3) uint8, consecutive in time. key_index: (k,) ascending positions of the key frames in `rgb`, k >= 1.
        key_labels: (k, h, w) int16: 0 background, i + 1 entity i of `count`, -1 not known. An entity that a key frame
        does not show is out of sight there. Frames before the first and after the last key frame are reached from that
        key frame alone. `params` are those of this backend. Pure and deterministic; the inputs are not modified.
        """
        ...
