"""Rendered scenes: specifications of clips and stills, their ground truth, and labelled images for the hand finder."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from schemas.files import FileTree
from schemas.masks import Entity
from schemas.spec import Bundle, Schema, SchemaError, array, value
from schemas.video import Narration

if TYPE_CHECKING:
    import numpy as np

@dataclass(frozen=True)
class SceneSpec(Schema):
    """Specification of one clip. The same spec gives the same bytes."""

    video_id: str = value("EPIC-style id of the clip, e.g. P91_03")
    script: str = value("name of the choreography, e.g. 'pour', 'carry', 'open_jar'")
    setting: str = value("kitchen, workshop or desk")
    seed: int = value("seed of everything random in the clip")
    frames: int = value("length of the clip", default=121)
    key_gap: int = value("distance between annotated key frames", unit="frames", default=15)
    split: str = value("train or val", default="train")


@dataclass(frozen=True)
class StillSpec(Schema):
    """Specification of the stills of one room with objects of its own. The same spec gives the same bytes."""

    video_id: str = value("id of the set of stills, e.g. P81_03")
    setting: str = value("kitchen, workshop or desk")
    seed: int = value("seed of everything random in it")
    split: str = value("train, val or test")
    asks: str = value("known: objects and verbs that training shows; new: held-out ones; any: both")
    layouts: int = value("number of random layouts of the objects")
    views: int = value("images of each layout")
    tasks: int = value("maximum number of tasks of one image")


@dataclass(frozen=True)
class RenderedClip(Bundle):
    """Rendered video as files: an EPIC/VISOR root of one video, and its ground truth (see `ClipTruth`)."""

    files: FileTree = value("videos/, GroundTruth-SparseAnnotations/, EPIC_100_*.csv, as in an EPIC root")
    media: FileTree = value("those of `files` that hold pictures: the video file, or the frame images")
    truth: FileTree = value("truth/<video_id>/ of the same root")


@dataclass(frozen=True)
class Mode(Schema):
    """One valid way to do a task: the region of each hand."""

    masks: np.ndarray = array("4 h w", "bool", "affordance left, right; complete object left, right", encoding="rle")
    objects: tuple[str, str] = value("name of the (left, right) hand's object, '' for an idle hand")
    grips: tuple[str, str] = value("part that the (left, right) hand takes, e.g. 'handle'; '' for an idle hand")
    taxonomy: int = value("Taxonomy, 4-way: 0..3")
    weight: float = value("probability that a person does it this way; those of a still sum to 1")


@dataclass(frozen=True)
class Still(Schema):
    """One task in an image, with its valid modes."""

    number: int = value("1-based, unique in the video")
    image: int = value("index into Stills.images; several tasks share an image, so that only the text distinguishes them")
    narration: Narration = value("the task")
    kinds: tuple[str, ...] = value("kinds of the objects that it names")
    new: bool = value("whether the object, or this verb with it, is held out from training")
    modes: tuple[Mode, ...] = value("valid ways, likeliest first")


@dataclass(frozen=True)
class Picture(Schema):
    """One image as an encoded file."""

    jpeg: np.ndarray = array("b", "uint8", "JPEG bytes, no hands in it")


@dataclass(frozen=True)
class Stills(Schema):
    """Stills of one room."""

    video_id: str = value("stands for a video: stills of one room are never split")
    participant_id: str = value("e.g. P81")
    split: str = value("train, val or test")
    setting: str = value("kitchen, workshop or desk")
    width_px: int = value("image width; masks may be larger, with the same field of view", unit="px")
    height_px: int = value("image height", unit="px")
    images: tuple[Picture, ...] = value("n pictures")
    stills: tuple[Still, ...] = value("by number")


@dataclass(frozen=True)
class ClipTruth(Schema):
    """Ground truth of every frame of a rendered clip, exact by construction. Arrays are (t, h, w) at the size of the video."""

    clip_id: str = value("clip (the video id of the rendered clip)")
    hard: tuple[str, ...] = value("why the clip counts as hard, e.g. 'articulated'; empty for a standard clip")
    entities: tuple[Entity, ...] = value("n: left hand, right hand, then every annotated object, as in Tracks")
    frame: np.ndarray = array("t", "int64", "frame numbers, 1-based and consecutive")
    visible: np.ndarray = array("n t h w", "bool", "visible pixels of each entity", encoding="rle")
    amodal: np.ndarray = array("n t h w", "bool", "all pixels of the entity as if nothing stood before it", encoding="rle")
    rgb_no_hands: np.ndarray = array("t h w 3", "uint8", "the same frame without hands and their shadows", encoding="video")
    rgb_no_hands_shadow: np.ndarray = array(
        "t h w 3", "uint8", "the same frame without hands, their shadows kept", encoding="video")
    depth_mm: np.ndarray = array("t h w", "uint16", "distance along the optical axis, 0 = nothing", unit="mm", encoding="zstd")
    contact: np.ndarray = array("2 t", "int16", "entity index that the (left, right) hand truly touches, -1 for none")
    contact_mask: np.ndarray = array(
        "2 t h w", "bool", "pixels of the visible hand nearer to the touched surface than the threshold", encoding="rle")
    K: np.ndarray = array("3 3", "float64", "pinhole intrinsics", unit="px", frame="camera")
    T_world_cam: np.ndarray = array("t 4 4", "float64", "pose of the camera (x right, y down, z forward)", unit="m", frame="world")


REST, LEFT_HAND, RIGHT_HAND, TOUCHED, SLEEVE = range(5)
"""pixel labels: other; skin of a hand and its arm, with glove or watch; touched object; sleeve"""


@dataclass(frozen=True)
class HandRoom(Schema):
    """Specification of a room for labelled images of hands. The same room gives the same bytes."""

    name: str = value("e.g. P71_003")
    setting: str = value("kitchen, workshop or desk")
    seed: int = value("seed of everything random in it")
    split: str = value("train or val")


@dataclass(frozen=True)
class HandLessons(Schema):
    """Labelled images of hands in one room."""

    name: str = value("of the room")
    split: str = value("train or val")
    pictures: np.ndarray = array("n h w 3", "uint8", "RGB, the person on the near side", encoding="zstd")
    labels: np.ndarray = array("n h w", "uint8", "what each pixel is: REST .. SLEEVE", encoding="zstd")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.labels.size and self.labels.max() > SLEEVE:
            raise SchemaError(f"HandLessons.labels: expected 0..{SLEEVE}, got {self.labels.max()}")
