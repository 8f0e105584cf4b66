"""narration intervals -> verb, noun, classes and text of every frame.

Reads   Clip (narrations), Frames (frame numbers)
Writes  FrameLabels: (frame, narration) pairs, ids of narrations that match no frame, ids dropped because of their verb
Method  a frame takes the narrations whose interval holds it; overlaps are settled by `policy`. Verbs and nouns outside EPIC's
        map stay classes of their own. Which hand acts is never read off the words
Fails   unknown policy
Paper   2HandedAfforder section 3 (labels from narrations); the released code is `policy=last`
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.affordance import FrameLabels
from schemas.video import Clip, Frames

LIBRARIES = ("numpy",)
THREADS = 1
MEMORY_GIB = 0.5
POLICIES = {
    "last": "afford.extraction.labels:last",
    "shortest": "afford.extraction.labels:shortest",
    "all": "afford.extraction.labels:all_narrations",
}


@dataclass(frozen=True)
class Params:
    policy: str = "last"
    """which of several narrations labels a frame: last in the file, shortest interval, or all of them"""
    excluded: tuple[str, ...] = ("eat", "look", "search", "feel", "transition", "wait", "smell", "finish", "unfreeze")
    """verbs, or keys of verb classes, that say nothing about where to hold"""


def run(clip: Clip, frames: Frames, params: Params) -> FrameLabels:
    """Label the frames of a clip; frames without a narration get no row."""
    from afford.common.registry import load
    from afford.extraction.labels import label_frames

    return label_frames(clip, frames.frame, params.excluded, load(POLICIES, params.policy))
