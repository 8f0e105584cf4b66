"""Sparse key-frame masks and frames -> a mask of every hand and every touched object on every frame.

Reads   Clip (key frames, contact), Frames (t h w 3); files of a model (sam2).
Writes  Tracks: visible masks (n t h w) that do not overlap, confidence, flags, source key frame, contact of each hand.
Method  `flow` (default, CPU, deterministic): optical flow from both bracketing key frames, fused and refined;
        `nearest` repeats the nearest key frame; `dense` takes VISOR's ready-made tracks; `sam2` (weights
        needed, GPU advised) follows the masks of key frames both ways and trusts the nearer one more.
        Motion is never chained across missing frames. Entities are linked by side or name, same-name objects of one
        image by propagated overlap.
Fails   when no key frame of the clip was decoded.
Paper   2HandedAfforder section 3 (XMem, 10 frames each way); VISOR (Darkhalil et al. 2022) for masks and contact.
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.masks import Tracks
from schemas.video import Clip, Frames

LIBRARIES = ("numpy", "opencv-python-headless", "numba", "scipy", "torch", "transformers", "safetensors")
THREADS = 1
MEMORY_GIB = 2.0

BACKENDS = {
    "flow": "afford.extraction.tracks.propagate.flow:propagate",
    "nearest": "afford.extraction.tracks.propagate.nearest:propagate",
    "dense": "afford.extraction.tracks.propagate.dense:propagate",
    "sam2": "afford.extraction.tracks.propagate.sam2:propagate",
}


@dataclass(frozen=True)
class Params:
    backend: str = "flow"
    """how labels spread from key frames: flow, nearest, dense (ready-made VISOR tracks), or sam2"""
    model: str = ""
    """sam2: local folder or hub id of a Sam2VideoModel, or sam2*_hiera_*.pt"""
    search_px: int = 1
    """flow: how far around a supposed motion patches are searched; 2 is a little better and twice as slow"""
    band_px: int = 4
    """flow: pixels this close to an outline are decided by patches"""
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
    device: str = "cpu"
    """sam2: cpu, cuda or cuda:N; bytes differ between kinds of device"""
    dtype: str = "float32"
    """sam2: float32, bfloat16 or float16"""
    memory_keys: int = 2
    """sam2: key frames on each side of a gap that the model remembers"""
    cache_frames: int = 16
    """sam2: frames whose image features are kept for the way back; about 0.1 GB each at the published sizes"""


def run(clip: Clip, frames: Frames, params: Params, weights: FileTree | None = None) -> Tracks:
    """Tracks of the clip on every frame of `frames`; ValueError when none of its key frames is among them."""
    from afford.common.registry import load
    from afford.extraction.tracks.densify import densify
    from afford.models.weights import placed

    return densify(clip, frames, load(BACKENDS, params.backend), placed(params, weights))
