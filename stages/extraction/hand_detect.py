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
from typing import Literal

from schemas.files import FileTree
from schemas.video import Clip, Frames

LIBRARIES = ("numpy", "opencv-python-headless", "numba", "scipy", "torch", "transformers", "safetensors", "tokenizers")
THREADS = 1
MEMORY_GIB = 2.5

BACKENDS = {
    "network": "afford.extraction.hands.network:find",
    "sam3": "afford.extraction.hands.sam3:find",
}


@dataclass(frozen=True)
class Params:
    backend: str = "network"
    """who finds hands in single pictures: network (trained here) or sam3"""
    model: str = ""
    """sam3: local folder or hub id of a Sam3Model"""
    viewpoint: Literal["ego", "facing"] = "ego"
    """ego: a head camera, arms come from below; facing: the person is seen from the front, or sits at the far side of the table"""
    every_s: float = 0.5
    """seconds between two key frames"""
    look_s: float = 0.1
    """seconds between two frames that are looked at"""
    least_hand: float = 0.002
    """smallest part of a hand, as a share of the picture's area"""
    least_like: float = 0.2
    """smallest hand, as a share of the usual size of the largest one in sight in this clip"""
    least_object: float = 0.001
    """smallest part of an object, as a share of the picture's area"""
    least_part: float = 0.25
    """hands that touch are parted where each is at least this share of both"""
    memory: float = 0.5
    """weight of what motion carries from one look to the next, against 1 for what is seen there"""
    colour: float = 0.6
    """weight of the clip's own colours of hands, against 1 for what the finder says (log odds)"""
    motion: float = 4.0
    """weight of moving as the hand does, against 1 for what the finder says of objects (log odds)"""
    sleeve: float = 8.0
    """weight of being a sleeve against being an object (log odds)"""
    lasting: float = 0.8
    """weight of what is known of objects from one look to the next, against 1 for what is seen there"""
    edge_px: int = 4
    """radius within which outlines of hands are drawn to edges of the picture"""
    link_min_iou: float = 0.2
    """overlap from which a part of one look is the one of the look before"""
    leap: float = 0.25
    """farthest that a hand moves from one look to the next, as a share of the picture's width"""
    gap_looks: int = 4
    """looks for which something may be out of sight and still be the same"""
    rest_looks: int = 15
    """looks for which a thing that a hand moved is still there when it rests"""
    least_looks: int = 3
    """looks in which a hand, an object and a touch must be seen to be one"""
    order: float = 0.3
    """what it counts that a left hand is to the left of the right one, against a sure look at one of them"""
    entry: float = 0.3
    """what it counts at which side of the picture an arm comes in"""
    near: float = 0.08
    """parts of one hand are at most this far apart, as a share of the picture's width"""
    far: float = 0.25
    """what a hand moves is at most this far from it, as a share of the picture's width"""
    reach_px: int = 4
    """a hand dilated by this much touches what it overlaps"""
    batch: int = 16
    """pictures that a backend is shown at a time"""
    threshold: float = 0.5
    """sam3: least score of what counts as a hand"""
    device: str = "cpu"
    """sam3: cpu, cuda or cuda:N; bytes differ between kinds of device"""
    dtype: str = "float32"
    """sam3: float32, bfloat16 or float16"""


def run(clip: Clip, frames: Frames, params: Params, weights: FileTree | None = None) -> Clip:
    """The clip with the hands that were found; ValueError when the finder cannot be used."""
    from afford.common.registry import load
    from afford.extraction.hands.clip import detect

    return detect(clip, frames, load(BACKENDS, params.backend), params, weights)
