"""Affordance masks per frame, narration labels of frames, and samples of a data set."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

from schemas.masks import Entity
from schemas.spec import Schema, array, value
from schemas.video import Narration

if TYPE_CHECKING:
    import numpy as np

class Taxonomy(IntEnum):
    """2HandedAfforder's four classes in the order of the released one-hot vectors; NONE means no hand in contact."""

    NONE = -1
    LEFT = 0
    RIGHT = 1
    BOTH_SAME = 2
    BOTH_DIFFERENT = 3


TAXONOMY = tuple(one.name.lower() for one in Taxonomy if one is not Taxonomy.NONE)
"""names of the four classes in their order: left, right, both_same, both_different"""
TAKES = ((True, False), (False, True), (True, True), (True, True))
"""whether each class uses the (left, right) hand"""
MIRRORED = (Taxonomy.RIGHT, Taxonomy.LEFT, Taxonomy.BOTH_SAME, Taxonomy.BOTH_DIFFERENT)
"""class of the mirrored sample"""


class Rejection(IntEnum):
    """Reason why a frame gives no sample; ACCEPTED for a frame that gives one."""

    ACCEPTED = 0
    NO_CONTACT = 1
    CONTACT_UNKNOWN = 2
    OBJECT_MISSING = 3
    EMPTY_INTERSECTION = 4
    TOO_SMALL = 5
    TOO_LARGE = 6
    LOW_QUALITY = 7


@dataclass(frozen=True)
class Affordances(Schema):
    """Affordance masks of the left and the right hand per frame: complete object AND same-side hand, optionally dilated."""

    clip_id: str = value("clip")
    objects: tuple[Entity, ...] = value("n objects that `object_index` points into")
    frame: np.ndarray = array("t", "int64", "frame numbers of the data set, ascending")
    masks: np.ndarray = array("2 t h w", "bool", "affordance of the (left, right) hand", encoding="rle")
    object_index: np.ndarray = array("2 t", "int16", "object of the (left, right) hand, -1 for none")
    taxonomy: np.ndarray = array("t", "int8", "Taxonomy, 4-way")
    taxonomy3: np.ndarray = array("t", "int8", "0 one hand, 1 both on one object, 2 both on different ones, -1 none")
    quality: np.ndarray = array("t", "float32", "0..1 score of the sample")
    rejection: np.ndarray = array("t", "uint8", "Rejection")


@dataclass(frozen=True)
class FrameLabels(Schema):
    """Narrations of each frame. A frame may have none, or several under policy `all`."""

    clip_id: str = value("clip")
    narrations: tuple[Narration, ...] = value("n narrations that label at least one frame")
    frame: np.ndarray = array("m", "int64", "frame numbers of the data set, ascending, repeated under policy `all`")
    narration: np.ndarray = array("m", "int32", "index into `narrations`")
    unmatched: tuple[str, ...] = value("narration ids that match no frame of the clip")
    excluded: tuple[str, ...] = value("narration ids dropped because of their verb")


@dataclass(frozen=True)
class Sample(Schema):
    """One frame with its task: a sample in the sense of 2HANDS."""

    sample_id: str = value("unique in the data set: <video>_<frame>[_<narration>]")
    frame: int = value("frame number of the data set")
    time_ns: int = value("media time", unit="ns")
    image_jpeg: np.ndarray = array("b", "uint8", "JPEG bytes of the frame, hands removed")
    masks: np.ndarray = array("4 h w", "bool", "affordance left, right; complete object left, right", encoding="rle")
    object_left: str = value("name of the left hand's object, '' for none")
    object_right: str = value("name of the right hand's object, '' for none")
    narration: Narration = value("the task")
    taxonomy: int = value("Taxonomy, 4-way: 0..3")
    quality: float = value("0..1")
    inpaint_confidence: float = value("mean confidence of the replaced pixels, 0..1")
    key_frame: int = value("key frame the masks lean on")
    key_distance: int = value("distance to it", unit="frames")
    motion: np.ndarray = array("4 s 2", "float32", "x, y of left hand, right hand, left object, right object; NaN unknown",
                               unit="px", frame="image")
    motion_time_ns: np.ndarray = array("s", "int64", "time of each motion step after the sample", unit="ns")


@dataclass(frozen=True)
class Samples(Schema):
    """Samples of a clip, and counts of the frames without a sample by reason."""

    clip_id: str = value("clip")
    video_id: str = value("video")
    participant_id: str = value("participant")
    split: str = value("train, val, test as the source says; '' when it does not")
    width_px: int = value("image width", unit="px")
    height_px: int = value("image height", unit="px")
    samples: tuple[Sample, ...] = value("by frame")
    rejected: tuple[tuple[str, int], ...] = value("(reason, number of frames) of what gave no sample")
