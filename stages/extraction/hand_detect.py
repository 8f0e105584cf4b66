"""a clip without masks, its frames and a finder of hands -> the clip with key frames: hands, what they touch, and that they do.

Reads   Clip without key frames; Frames (t h w 3); files of the finder: what hands_train wrote, or a model of the user's
Writes  Clip with a key frame about every `every_s`: outlines of left and right hand and of what they touch, contact
Method  the backend says of frames `look_s` apart how likely each pixel is left hand, right hand, touched object; optical flow
        carries that to the neighbours; the colours of what is surely hand in this clip draw the line to sleeve and wood, edges of
        the picture the outline. Parts are followed in time; each votes for one side with all its looks; short ones are dropped,
        short gaps filled. An object is what the finder takes for one beside a hand, or what moves as the hand does, now or within
        the next or last looks; colours of the look draw its outline (GrabCut); a touch lasts
Fails   when the finder's files are missing, or are those of another model
Paper   takes the place of VISOR's annotators where there are none
"""

from __future__ import annotations

from dataclasses import dataclass

from afford.extraction.hands import Detection, Sam3
from schemas.files import FileTree
from schemas.video import Clip, Frames

LIBRARIES = ("numpy", "opencv-python-headless", "numba", "scipy", "torch", "safetensors")
BACKEND_LIBRARIES = {"sam3": ("transformers", "tokenizers")}
THREADS = 1
MEMORY_GIB = 2.5
BACKEND_MEMORY_GIB = {"sam3": 6.0}

BACKENDS = {
    "network": "afford.extraction.hands.network:find",
    "sam3": "afford.extraction.hands.sam3:find",
}


@dataclass(frozen=True)
class Params(Detection):
    backend: str = "network"
    """who finds hands in single pictures: network (trained here) or sam3"""
    sam3: Sam3 = Sam3()
    """parameters of sam3"""


def run(clip: Clip, frames: Frames, params: Params, weights: FileTree | None = None) -> Clip:
    """The clip with the hands that were found; ValueError when the finder cannot be used."""
    from functools import partial

    from afford.common.registry import block, load
    from afford.extraction.hands.detect import detect

    find = partial(load(BACKENDS, params.backend), params=block(params, params.backend), weights=weights)
    return detect(clip, frames, find, params)
