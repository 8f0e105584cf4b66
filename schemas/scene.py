"""Rendered worlds: specifications of clips and stills, their ground truth, and pictures to train a hand finder on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from schemas.files import FileTree
from schemas.masks import Entity
from schemas.spec import Schema, SchemaError, array, value
from schemas.video import Narration

if TYPE_CHECKING:
    import numpy as np

@dataclass(frozen=True)
class SceneSpec(Schema):
    """One clip to render. The same spec gives the same bytes."""

    video_id: str = value("EPIC-style id of the clip, e.g. P91_03")
    script: str = value("name of the choreography, e.g. 'pour', 'carry', 'open_jar'")
    setting: str = value("kitchen, workshop or desk")
    seed: int = value("seed of everything random in the clip")
    frames: int = value("length of the clip", default=121)
    key_gap: int = value("distance between annotated key frames", unit="frames", default=15)
    split: str = value("train or val", default="train")


@dataclass(frozen=True)
class StillSpec(Schema):
    """One room with things of its own, of which stills are rendered. The same spec gives the same bytes."""

    video_id: str = value("id of the set of stills, e.g. P81_03")
    setting: str = value("kitchen, workshop or desk")
    seed: int = value("seed of everything random in it")
    split: str = value("train, val or test")
    asks: str = value("known: things and verbs that training shows; new: what it never shows; any: both")
    layouts: int = value("how often the things are laid out anew")
    views: int = value("pictures of each layout")
    tasks: int = value("most tasks asked of one picture")


@dataclass(frozen=True)
class RenderedClip(Schema):
    """A video as files: an EPIC/VISOR root of one video, and, apart, its ground truth (see `ClipTruth`)."""

    files: FileTree = value("videos/, GroundTruth-SparseAnnotations/, EPIC_100_*.csv, as in an EPIC root")
    media: FileTree = value("those of `files` that hold pictures: the video file, or the frame images")
    truth: FileTree = value("truth/<video_id>/ of the same root")


@dataclass(frozen=True)
class Mode(Schema):
    """One valid way to do a task: where each hand goes."""

    masks: np.ndarray = array("4 h w", "bool", "affordance left, right; complete object left, right", encoding="rle")
    objects: tuple[str, str] = value("name of the (left, right) hand's object, '' for an idle hand")
    grips: tuple[str, str] = value("part that the (left, right) hand takes, e.g. 'handle'; '' for an idle hand")
    taxonomy: int = value("Taxonomy, 4-way: 0..3")
    weight: float = value("probability that a person does it this way; those of a still sum to 1")


@dataclass(frozen=True)
class Still(Schema):
    """A task in a picture."""

    number: int = value("1-based, unique in the video")
    image: int = value("index into Stills.images; several tasks share a picture, so that only the text tells them apart")
    narration: Narration = value("the task")
    kinds: tuple[str, ...] = value("kinds of the things that it speaks of")
    new: bool = value("whether training never shows such a thing, or never this verb with it")
    modes: tuple[Mode, ...] = value("valid ways, likeliest first")


@dataclass(frozen=True)
class Picture(Schema):
    """One image as a file."""

    jpeg: np.ndarray = array("b", "uint8", "JPEG bytes, no hands in it")


@dataclass(frozen=True)
class Stills(Schema):
    """All stills of one room with its own things."""

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
    """What is true of every frame of a rendered clip, by construction. Arrays are (t, h, w) at the size of the video."""

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
"""labels of pixels: anything else; skin of a hand and its arm, with glove or watch; a thing that a hand touches; cloth on an arm"""


@dataclass(frozen=True)
class HandRoom(Schema):
    """A room to render lessons in. The same room gives the same bytes."""

    name: str = value("e.g. P71_003")
    setting: str = value("kitchen, workshop or desk")
    seed: int = value("seed of everything random in it")
    split: str = value("train or val")


@dataclass(frozen=True)
class HandLessons(Schema):
    """The lessons of one room."""

    name: str = value("of the room")
    split: str = value("train or val")
    pictures: np.ndarray = array("n h w 3", "uint8", "RGB, the person on the near side", encoding="zstd")
    labels: np.ndarray = array("n h w", "uint8", "what each pixel is: REST .. SLEEVE", encoding="zstd")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.labels.size and self.labels.max() > SLEEVE:
            raise SchemaError(f"HandLessons.labels: expected 0..{SLEEVE}, got {self.labels.max()}")
