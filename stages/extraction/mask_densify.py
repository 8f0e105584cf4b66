"""Propagate sparse key-frame masks to a mask of every hand and every touched object on every frame.

Reads   Clip (key frames, contact), Frames (t h w 3); files of a model (sam2, xmem).
Writes  Tracks: visible masks (n t h w) that do not overlap, confidence, flags, source key frame, contact of each hand.
Method  `flow` (default, CPU, deterministic): optical flow from both bracketing key frames, refined by patch matching;
        `nearest` copies the nearest key frame; `dense` copies the dense annotations of VISOR; `sam2` and `xmem`
        (weights needed, GPU advised) propagate masks in both directions, weighted by nearness. Motion is never chained across
        missing frames. Entities are linked by side or name, same-name objects of one image by propagated overlap.
Fails   when no key frame of the clip was decoded.
Paper   2HandedAfforder section 3 (XMem, 10 frames each way); VISOR (Darkhalil et al. 2022) for masks and contact.
"""

from __future__ import annotations

from dataclasses import dataclass

from afford.extraction.tracks import Flow, Sam2, Tracking, Xmem
from schemas.files import FileTree
from schemas.masks import Tracks
from schemas.video import Clip, Frames

LIBRARIES = ("numpy", "opencv-python-headless", "scipy")
BACKEND_LIBRARIES = {"flow": ("numba",), "sam2": ("torch", "transformers", "safetensors"), "xmem": ("torch", "safetensors")}
THREADS = 1
MEMORY_GIB = 2.0
BACKEND_MEMORY_GIB = {"sam2": 6.0, "xmem": 4.0}
BACKEND_GPUS = {"sam2": "sam2.device", "xmem": "xmem.device"}
GPU_SHARED = True
TIMEOUT_S = 86400.0  # reports no progress: minutes for most clips, hours for a long one with a model on a CPU

BACKENDS = {
    "flow": "afford.extraction.tracks.flow:propagate",
    "nearest": "afford.extraction.tracks.densify:nearest",
    "dense": "afford.extraction.tracks.densify:dense",
    "sam2": "afford.extraction.tracks.sam2:propagate",
    "xmem": "afford.extraction.tracks.xmem:propagate",
}


@dataclass(frozen=True)
class Params(Tracking):
    """Parameters of `mask_densify`."""

    backend: str = "flow"
    """backend that propagates labels: flow, nearest, dense (dense annotations of VISOR), sam2, or xmem"""
    flow: Flow = Flow()
    """parameters of flow"""
    sam2: Sam2 = Sam2()
    """parameters of sam2"""
    xmem: Xmem = Xmem()
    """parameters of xmem"""


def run(clip: Clip, frames: Frames, params: Params, weights: FileTree | None = None) -> Tracks:
    """Densify the masks of a clip on every frame of `frames`; ValueError when `frames` contain no key frame."""
    from functools import partial

    from afford.common.registry import block, load
    from afford.extraction.tracks.densify import densify
    from afford.models.weights import with_local_weights

    propagate = partial(load(BACKENDS, params.backend), params=with_local_weights(block(params, params.backend), weights))
    return densify(clip, frames, propagate, params, dense=params.backend == "dense")
