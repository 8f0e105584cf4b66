"""Video clips: key frames with sparse masks, narrations, decoded frames, inpainted frames, and the two hands."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING, Literal

from schemas.spec import Schema, array, value

if TYPE_CHECKING:
    import numpy as np

Side = Literal["left", "right", "both", ""]
NOT_IN_CONTACT = ("hand-not-in-contact", "glove-not-in-contact", "none-of-the-above")
UNKNOWN_CONTACT = ("inconclusive", "")


@dataclass(frozen=True)
class Polygon(Schema):
    """One closed outline, as annotated."""

    points: np.ndarray = array("n 2", "float32", "x, y of the corners", unit="px", frame="annotation grid")


@dataclass(frozen=True)
class Annotation(Schema):
    """One mask of one key frame. All its polygons are drawn together, even-odd (VISOR's convention)."""

    annotation_id: str = value("unique in the data set (VISOR: one id per mask per frame)")
    name: str = value("entity name; hands are exactly 'left hand' and 'right hand'")
    class_id: int = value("EPIC noun class, -1 when unknown")
    side: Side = value("whose hand this is (gloves count as the hand they are on); '' for objects")
    contact: str = value("hands only: annotation_id of the touched object, or VISOR's words; '' when not given")
    exhaustive: str = value("y, n or inconclusive: whether every instance is annotated")
    polygons: tuple[Polygon, ...] = value("outlines")


@dataclass(frozen=True)
class KeyFrame(Schema):
    """Annotations of one frame."""

    frame: int = value("1-based frame number of the data set")
    width_px: int = value("width of the annotation grid", unit="px")
    height_px: int = value("height of the annotation grid", unit="px")
    annotations: tuple[Annotation, ...] = value("in file order")
    dense: bool = value("True for ready-made (interpolated) masks, which carry no contact of their own", default=False)


@dataclass(frozen=True)
class Narration(Schema):
    """One narrated action: an interval of frames and its words. Intervals are inclusive and may overlap."""

    narration_id: str = value("unique in the data set")
    start_frame: int = value("first frame, data-set numbering")
    stop_frame: int = value("last frame, data-set numbering")
    text: str = value("the sentence as narrated")
    verb: str = value("verb as narrated, e.g. 'pick-up'")
    verb_class: int = value("EPIC class id, -1 when outside EPIC's map")
    verb_key: str = value("key of the class; a class outside EPIC's map is keyed by its own word")
    noun: str = value("noun as narrated, e.g. 'board:chopping'")
    noun_class: int = value("EPIC class id, -1 when outside EPIC's map")
    noun_key: str = value("key of the class; a class outside EPIC's map is keyed by its own word")
    all_nouns: tuple[str, ...] = value("every noun of the sentence")


@dataclass(frozen=True)
class Clip(Schema):
    """Segment of one video with its key frames and narrations; long videos are cut at gaps between key frames."""

    clip_id: str = value("video id, with a suffix _sNN when the video is cut")
    video_id: str = value("EPIC video id, e.g. P03_101")
    participant_id: str = value("e.g. P03; data-set splits keep a participant's videos together on request")
    split: str = value("train, val or test as the source says; '' when it does not")
    media: tuple[str, ...] = value("names of the video file, or of the frame images in frame order")
    media_kind: Literal["video", "frames"] = value("how `media` is to be read")
    fps: float = value("frame rate that the data set's numbers refer to", unit="1/s")
    resample: bool = value("True: frame n is at (n - 1) / fps (EPIC's 50/60 rule); False: frame n is the n-th decoded frame")
    first_frame: int = value("first frame of the clip, data-set numbering")
    last_frame: int = value("last frame of the clip, inclusive")
    key_frames: tuple[KeyFrame, ...] = value("sorted by frame; the sparse truth of annotators")
    narrations: tuple[Narration, ...] = value("those that touch the clip, in file order")
    warnings: tuple[str, ...] = value("what the reader corrected or skipped, one sentence each")
    spans: tuple[tuple[int, int], ...] = value("(offset, size) of each of `media` in the tar that holds them; else empty",
                                               unit="bytes", default=())


@dataclass(frozen=True)
class Footage(Schema):
    """Media and frame numbers of a clip, without its annotations."""

    clip_id: str = value("clip")
    media: tuple[str, ...] = value("names of the video file, or of the frame images in frame order")
    media_kind: Literal["video", "frames"] = value("how `media` is to be read")
    fps: float = value("frame rate that the data set's numbers refer to", unit="1/s")
    resample: bool = value("True: frame n is at (n - 1) / fps (EPIC's 50/60 rule); False: frame n is the n-th decoded frame")
    first_frame: int = value("first frame, data-set numbering")
    last_frame: int = value("last frame, inclusive")
    key_frames: tuple[int, ...] = value("frames that annotators looked at, ascending; one of them must be there; none: any will do")
    spans: tuple[tuple[int, int], ...] = value("(offset, size) of each of `media` in the tar that holds them; else empty",
                                               unit="bytes", default=())


Hand = Literal["left", "right"]
SIDES: tuple[Hand, Hand] = ("left", "right")
OTHER = {"left": "right", "right": "left"}
HAND_CLASS: dict[Hand, int] = {"left": 300, "right": 301}
"""EPIC noun classes v2: hand:left, hand:right"""


@dataclass(frozen=True)
class Frames(Schema):
    """Decoded frames, not necessarily consecutive: a source without video has its key frames only."""

    clip_id: str = value("clip")
    frame: np.ndarray = array("t", "int64", "frame numbers of the data set, ascending")
    time_ns: np.ndarray = array("t", "int64", "media time from the start of the video", unit="ns")
    rgb: np.ndarray = array("t h w 3", "uint8", "RGB images", unit="0..255 sRGB", encoding="video")


class PixelSource(IntEnum):
    """Origin of a pixel in an inpainted frame."""

    ORIGINAL = 0
    BACKGROUND = 1
    OBJECT = 2
    SPATIAL = 3


@dataclass(frozen=True)
class Inpainted(Schema):
    """Frames with the hands removed. Outside `mask` the pixels equal those of `Frames`."""

    clip_id: str = value("clip")
    frame: np.ndarray = array("t", "int64", "frame numbers of the data set, ascending")
    rgb: np.ndarray = array("t h w 3", "uint8", "RGB images without hands", unit="0..255 sRGB", encoding="video")
    mask: np.ndarray = array("t h w", "bool", "pixels that were replaced: hands, dilated", encoding="rle")
    source: np.ndarray = array("t h w", "uint8", "PixelSource of each pixel", encoding="zstd")
    confidence: np.ndarray = array("t h w", "uint8", "255 = seen directly, 0 = guessed", encoding="zstd")
