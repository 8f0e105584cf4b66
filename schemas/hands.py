"""Hands of people in video: landmarks of single frames, the two hands over time, key frames and hand motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from schemas.hand import HandMotion
from schemas.spec import Bundle, Schema, array, value
from schemas.video import Clip

if TYPE_CHECKING:
    import numpy as np


@dataclass(frozen=True)
class HandLandmarks(Schema):
    """Hand landmarks of all detections in the sampled frames of a clip; 21 keypoints in the order of schemas.hand.KEYPOINTS."""

    clip_id: str = value("clip")
    frame: np.ndarray = array("t", "int64", "sampled frames, data-set numbering, ascending")
    time_ns: np.ndarray = array("t", "int64", "media time from the start of the video", unit="ns")
    width_px: int = value("width of the grid of keypoints_px", unit="px")
    height_px: int = value("height of the grid of keypoints_px", unit="px")
    index: np.ndarray = array("n", "int32", "position in `frame` of each detection, ascending")
    keypoints_px: np.ndarray = array("n 21 2", "float32", "x, y of each keypoint", unit="px", frame="image of width_px x height_px")
    keypoints_m: np.ndarray = array("n 21 3", "float32", "keypoints at the size of the model's hand, origin in the hand's centre",
                                    unit="m", frame="axes of the camera: x right, y down, z away")
    presence: np.ndarray = array("n", "float32", "probability that the crop contains a hand, 0..1")
    right: np.ndarray = array("n", "float32", "probability of a right hand by the landmark model, 0..1")


@dataclass(frozen=True)
class HandTracks(Schema):
    """Left and right hand of one person over time: keypoints and finger contact. Left and right are the person's own."""

    clip_id: str = value("clip")
    frame: np.ndarray = array("t", "int64", "frames, data-set numbering, ascending")
    time_ns: np.ndarray = array("t", "int64", "media time from the start of the video", unit="ns")
    width_px: int = value("width of the grid of keypoints_px: the working size of Frames", unit="px")
    height_px: int = value("height of the grid of keypoints_px", unit="px")
    seen: np.ndarray = array("2 t", "bool", "whether a mask of the (left, right) hand exists")
    keypoints_px: np.ndarray = array("2 t 21 2", "float32", "x, y of each keypoint; 0 where there are no landmarks", unit="px",
                                     frame="image of width_px x height_px")
    confidence: np.ndarray = array("2 t 21", "float32", "confidence of each keypoint, 0..1; 0 where there are no landmarks")
    keypoints_m: np.ndarray = array("2 t 21 3", "float32", "keypoints at the assumed hand size and focal length; else 0",
                                    unit="m", frame="camera: x right, y down, z away")
    finger_contact: np.ndarray = array("2 t 5", "float32", "probability that thumb, index, middle, ring, little finger touch the "
                                       "object in the hand; 0 where unknown")
    focal_px: float = value("assumed focal length for width_px", unit="px")


@dataclass(frozen=True)
class DetectedHands(Bundle):
    """Output of hand_detect: the clip with key frames, and the two hands over time."""

    clip: Clip = value("clip with the detected key frames; its warnings end with those of the detection")
    hands: HandTracks = value("two hands over time")

    @property
    def clip_id(self) -> str:
        """Clip."""
        return self.clip.clip_id


@dataclass(frozen=True)
class MotionRemarks(Schema):
    """Parts of a clip from which no hand motion was taken, with reasons."""

    clip_id: str = value("clip")
    texts: tuple[str, ...] = value("one sentence each")


@dataclass(frozen=True)
class VideoMotions(Bundle):
    """Output of hand_motion: the motions of the hands of one clip."""

    remarks: MotionRemarks = value("what was left out, and why")
    motions: tuple[HandMotion, ...] = value("one for each uninterrupted run of a hand, left before right, in time order")
