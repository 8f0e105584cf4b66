"""Mask tracks of hands and objects: parameters, and the interface of the backends that propagate labels.

A backend decides which entity every pixel of every frame belongs to, given the labels of a few key frames. `densify` builds tracks
around it: it links annotations to entities, propagates their masks and derives the contact of each hand.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from afford.common.registry import Own
from afford.models.weights import Pretrained

if TYPE_CHECKING:
    import numpy as np


@dataclass(frozen=True)
class Tracking:
    """Parameters of tracks, common to all backends."""

    radius: int = 0
    """masks farther than this from their key frame are dropped, frames; 0 = full length (released code: 10)"""
    max_step_frames: int = 1
    """labels are not propagated between neighbouring frames whose numbers differ by more than this"""
    keep_untouched: bool = False
    """also keep annotated objects that no hand touches in any key frame"""
    link_min_iou: float = 0.1
    """least IoU that identifies a same-name object with one of the previous key frame"""
    contact_reach_px: int = 4
    """a hand dilated by this much touches the object it overlaps; used where the source does not annotate contact"""


BACKGROUND = 0
UNKNOWN = -1
"""label of a pixel that belongs to no known entity"""


@dataclass(frozen=True)
class Flow:
    """Parameters of `flow`."""

    search_px: int = 1
    """search radius of patches around a candidate motion; 2 is slightly more accurate and twice as slow"""
    band_px: int = 4
    """pixels this close to an outline are decided by patches"""


@dataclass(frozen=True)
class Sam2(Pretrained):
    """Parameters of `sam2`."""

    model: str = ""
    """local folder or hub id of a Sam2VideoModel, or sam2*_hiera_*.pt"""
    memory_keys: int = 2
    """key frames on each side of a gap that prompt the model"""
    cache_frames: int = 16
    """frames whose image features are kept for the backward pass; about 0.1 GB each at the published sizes"""


@dataclass(frozen=True)
class Xmem(Pretrained):
    """Parameters of `xmem`. Sizes of the memory are those of the release."""

    model: str = ""
    """XMem.pth as released, or a folder of `weights import xmem`"""
    memory_keys: int = 1
    """key frames on each side of a gap that are in memory; 0 = only that from which a pass starts, as released"""
    short_side_px: int = 480
    """shorter side of frames in the network"""
    stride_frames: int = 5
    """every so many frames one is stored in memory; r of the paper (released code of 2HandedAfforder: 10)"""
    top_k: int = 30
    """elements of the memory that a place of a frame reads"""
    least_frames: int = 5
    """frames in working memory after a consolidation; T_min of the paper"""
    most_frames: int = 10
    """frames in working memory that start a consolidation; T_max of the paper"""
    prototypes: int = 128
    """elements that a consolidation adds to the long-term memory; P of the paper"""
    long_term: int = 10_000
    """elements of the long-term memory; LT_max of the paper"""


@dataclass(frozen=True)
class Propagated:
    """Propagated labels: one per pixel, so that entities never overlap."""

    labels: np.ndarray
    """(t, h, w) int16: 0 background, i + 1 entity i. Key frames keep their labels, with unknown pixels set to background."""
    confidence: np.ndarray
    """(n, t) float32 in 0..1: confidence in the mask of entity i in frame t; 0 where it has no mask, 1 at key frames."""


class Propagate(Protocol[Own]):
    """Interface of a backend of `mask_densify`."""

    def __call__(self, rgb: np.ndarray, key_index: np.ndarray, key_labels: np.ndarray, count: int, params: Own) -> Propagated:
        """Propagate the labels of key frames over a run of consecutive frames.

        rgb: (t, h, w, 3) uint8, consecutive in time. key_index: (k,) ascending positions of the key frames in `rgb`, k >= 1.
        key_labels: (k, h, w) int16: 0 background, i + 1 entity i of `count`, -1 unknown. An entity that a key frame
        does not show is invisible there. Frames before the first and after the last key frame are propagated from that
        key frame alone. `params` are the parameters of the backend. Pure and deterministic; the inputs are not modified.
        """
        ...
