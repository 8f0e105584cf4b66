"""Detect hands and touched objects in a clip without masks: adds key frames with outlines, sides and contact.

Reads   Clip without key frames; Frames (t h w 3); files of the hand finder, written by hands_train, or a model of the user
Writes  Clip with a key frame about every `every_s`: outlines of left hand, right hand and touched objects, contact
Method  the backend computes probabilities of left hand, right hand, touched object and sleeve for frames `look_s` apart; optical
        flow smooths them over time; a colour model of the certain hand pixels of the clip, and a guided filter, refine them.
        Segments are linked over time; each track votes for one side with all its segments; short tracks are dropped, short gaps
        filled. An object is a segment at a hand with a high probability, or one that moves with the hand, now or shortly before
        or after; GrabCut draws its outline; short contacts are dropped
Fails   when the files of the hand finder are missing, or are those of another model
Paper   replaces the annotations of VISOR for video without masks; no paper
"""

from __future__ import annotations

from dataclasses import dataclass

from afford.extraction.hands import Detection, Sam3
from schemas.files import FileTree
from schemas.video import Clip, Frames

LIBRARIES = ("numpy", "opencv-python-headless", "numba", "scipy", "torch", "safetensors")
BACKEND_LIBRARIES = {"sam3": ("transformers", "tokenizers")}
THREADS = 1
MEMORY_GIB = 1.5
BACKEND_MEMORY_GIB = {"sam3": 6.0}
BACKEND_GPUS = {"sam3": "sam3.device"}
GPU_SHARED = True
TIMEOUT_S = 86400.0  # reports no progress: minutes for most clips, hours for a long one with a model on a CPU

BACKENDS = {
    "network": "afford.extraction.hands.network:find",
    "sam3": "afford.extraction.hands.sam3:find",
}


@dataclass(frozen=True)
class Params(Detection):
    """Parameters of `hand_detect`."""

    backend: str = "network"
    """backend that finds hands in single pictures: network (the hand finder, trained by hands_train) or sam3"""
    sam3: Sam3 = Sam3()
    """parameters of sam3"""


def run(clip: Clip, frames: Frames, params: Params, weights: FileTree | None = None) -> Clip:
    """Add the detected hands to a clip; ValueError when the hand finder cannot be used."""
    from functools import partial

    from afford.common.registry import block, load
    from afford.extraction.hands.detect import detect

    find = partial(load(BACKENDS, params.backend), params=block(params, params.backend), weights=weights)
    return detect(clip, frames, find, params)
