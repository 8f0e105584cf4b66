"""The samples one clip gives to the data set, small enough to be carried to `dataset_pack`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from schemas.clip import Narration
from schemas.spec import Schema, array, value

if TYPE_CHECKING:
    import numpy as np


@dataclass(frozen=True)
class Sample(Schema):
    """One frame with its task: what 2HANDS calls a sample."""

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
    """All samples of a clip, with what was left out and why."""

    clip_id: str = value("clip")
    video_id: str = value("video")
    participant_id: str = value("participant")
    split: str = value("train, val, test as the source says; '' when it does not")
    width_px: int = value("image width", unit="px")
    height_px: int = value("image height", unit="px")
    samples: tuple[Sample, ...] = value("by frame")
    rejected: tuple[tuple[str, int], ...] = value("(reason, number of frames) of what gave no sample")
