"""Detect hands and touched objects in a clip without masks: adds key frames with outlines, sides and contact, and keypoints.

Reads   Clip without key frames; Frames (t h w 3); HandLandmarks; files of a hand finder, written by hands_train, or a model of the
        user; files of the network of held objects, written by held_train, and MediaPipe's networks, whose encoder it reads; the
        networks of MobileSAM, which set-up fetches
Writes  DetectedHands: Clip with a key frame about every `every_s` (outlines of left hand, right hand and touched objects, contact),
        and HandTracks: 21 keypoints of both hands over time, in the picture and in metres
Method  landmarks of sampled frames are linked to tracks; a track is a hand when its presence, its colours and its size say so. Its
        masks follow from the shape of the landmarks, a colour model of the hands of the clip, and optical flow. A hand finder, if
        there is one, corrects these masks and adds hands without landmarks. Each track votes for one side by its arm, its place and
        the handedness of its landmarks. What may be a touched object: outlines that MobileSAM draws at points beside the fingers. A
        logistic regression ranks them, by their place at the hand, by what neither earlier nor later frames explain, after camera
        registration, and by motion with the hand; Viterbi chooses among them and no touch over time. Without MobileSAM GrabCut
        outlines what moves, and an object that never moves is rarely found. Sleeves leave the picture behind the wrist
Fails   when neither landmarks nor a hand finder are given, or the files of the finder are those of another model
Paper   MediaPipe Hands (Zhang et al. 2020) and Faster Segment Anything (Zhang et al. 2023) in place of the annotations of VISOR
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from afford.extraction.hands import Detection, Sam3
from schemas.files import FileTree
from schemas.hands import DetectedHands, HandLandmarks
from schemas.video import Clip, Frames

LIBRARIES = ("numpy", "opencv-python-headless", "numba", "scipy", "torch", "safetensors", "onnxruntime")
BACKEND_LIBRARIES = {"sam3": ("transformers", "tokenizers")}
THREADS = 1
MEMORY_GIB = 2.0
BACKEND_MEMORY_GIB = {"sam3": 6.0}
BACKEND_GPUS = {"sam3": "sam3.device"}
GPU_SHARED = True
TIMEOUT_S = 86400.0  # reports no progress: minutes for most clips, hours for a long one with a model on a CPU

BACKENDS = {
    "landmarks": "afford.extraction.hands.unaided:find",
    "network": "afford.extraction.hands.network:find",
    "sam3": "afford.extraction.hands.sam3:find",
}

NO_NETWORK, TRAINED = "none", "trained"
"""values of `held` beside a folder; the first is one of `segment` too"""
NO_OUTLINES = ("touched objects are outlined by motion alone: the networks of MobileSAM are not installed (`make setup` fetches "
               "them with npm)")  # fmt: skip


@dataclass(frozen=True)
class Params(Detection):
    """Parameters of `hand_detect`."""

    backend: str = "landmarks"
    """finder of hands beside the landmarks: landmarks (none), network (trained by hands_train on rendered rooms) or sam3"""
    segment: Literal["mobile_sam", "none"] = "mobile_sam"
    """promptable segmentation that outlines touched objects: mobile_sam, where set-up fetched it, or none: motion alone"""
    held: str = NO_NETWORK
    """network of held objects: none, trained (held_train runs first), or a folder of its files"""
    sam3: Sam3 = Sam3()
    """parameters of sam3"""


def run(
    clip: Clip, frames: Frames, params: Params, landmarks: HandLandmarks | None = None, weights: FileTree | None = None,
    held: FileTree | None = None, networks: FileTree | None = None, segment: FileTree | None = None,
) -> DetectedHands:
    """Add the detected hands to a clip; ValueError when nothing can find hands, or a network cannot be used.

    held: files of the network of held objects; networks: MediaPipe's networks, whose encoder it reads; segment: MobileSAM's.
    """
    from functools import partial

    from afford.common.registry import block, load
    from afford.extraction.hands.detect import detect

    if landmarks is None and params.backend == "landmarks":
        raise ValueError(f"{clip.clip_id}: hands are found by landmarks or by a hand finder, and there is neither; run "
                         "`make setup` with a network, or choose --set hand_detect.backend=network")
    find = partial(load(BACKENDS, params.backend), params=block(params, params.backend), weights=weights)
    hold = None
    if held is not None:
        from afford.extraction.hands.held_network import held_evidence, palm_detector

        hold = partial(held_evidence, files=held, palm=palm_detector(networks))
    outline = None
    if segment is not None:
        from afford.extraction.prompted.mobile_sam import segmenter

        outline = partial(segmenter, segment)
    elif params.segment != NO_NETWORK:
        clip = replace(clip, warnings=(*clip.warnings, NO_OUTLINES))
    return detect(clip, frames, find, params, landmarks, hold, outline)
