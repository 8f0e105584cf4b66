"""Label every frame with the verb, noun, classes and text of the narrations that cover it.

Reads   Clip (narrations), Frames (frame numbers)
Writes  FrameLabels: (frame, narration) pairs, ids of narrations that match no frame, ids dropped because of their verb
Method  a frame gets the narrations whose interval contains it; `policy` resolves overlaps. Verbs and nouns outside EPIC's map are
        classes of their own. The acting hand is never derived from the text
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
    """Parameters of `narration_labelling`."""

    policy: str = "last"
    """choice among several narrations of a frame: last in the file, shortest interval, or all"""
    excluded: tuple[str, ...] = ("eat", "look", "search", "feel", "transition", "wait", "smell", "finish", "unfreeze")
    """verbs, or keys of verb classes, without information about where to hold"""


def run(clip: Clip, frames: Frames, params: Params) -> FrameLabels:
    """Label the frames of a clip; frames without a narration get no row."""
    from afford.common.registry import load
    from afford.extraction.labels import label_frames

    return label_frames(clip, frames.frame, params.excluded, load(POLICIES, params.policy))
