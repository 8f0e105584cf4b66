"""Interactions seen by an RGB-D camera: what to show, what the sensor recorded, and what was true of it (SOR3D-AFF)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from schemas.files import FileTree
from schemas.spec import Schema, array, value

if TYPE_CHECKING:
    import numpy as np

AFFORDANCES = ("grasp", "cut", "lift", "push", "rotate", "hammer", "squeeze", "paint", "type")
"""the nine of SOR3D-AFF in the order in which the paper lists them; the released code sorts them by name, see CODE_ORDER.
Labels and results are by this order; files on disk carry colours and so know of neither"""
BACKGROUND = 9
"""label of what affords nothing; the last class in the paper and in the released code"""
CODE_ORDER = ("cut", "grasp", "hammer", "lift", "paint", "push", "rotate", "squeeze", "type")
"""the classes 0 to 8 of the released code (STCAE)"""
COLOURS_BGR = {
    "grasp": (0, 255, 0),
    "cut": (0, 165, 255),
    "lift": (40, 255, 0),
    "push": (240, 255, 120),
    "rotate": (60, 255, 0),
    "hammer": (100, 255, 0),
    "squeeze": (160, 255, 0),
    "paint": (200, 255, 0),
    "type": (240, 255, 0),
}
"""colours of mask files, blue, green, red, as the released code reads them; every other colour is background"""
OBJECT_TYPES = ("ball", "book", "bottle", "brush", "can", "cup", "hammer", "knife", "pitcher", "smartphone", "sponge")
"""those of the released code: eleven, where the paper says ten"""


@dataclass(frozen=True)
class InteractionSpec(Schema):
    """One sequence to render."""

    name: str = value("id of the sequence, unique")
    split: str = value("train or val")
    object_type: str = value("one of OBJECT_TYPES")
    affordance: str = value("one of AFFORDANCES")
    instance: str = value("which object of its type: shape, size and colours; never in both splits")
    instance_seed: int = value("of the object's shape, size and colours; the same for all sequences of an instance")
    subject: int = value("which person, from 1; never in both splits")
    seed: int = value("of the table, the light, the camera, the person and the motion")


@dataclass(frozen=True)
class InteractionClip(Schema):
    """An RGB-D sequence with the label of its last frame, from a sensor or made; colours lie on the grid of the depth."""

    name: str = value("id of the sequence, unique in its set")
    split: str = value("train or val")
    object_type: str = value("what is used")
    affordance: str = value("what it is used for: one of AFFORDANCES")
    rgb: np.ndarray = array("t h w 3", "uint8", "colours", encoding="zstd")
    depth_m: np.ndarray = array("t h w", "float32", "along the optical axis; 0 where the sensor saw none (or there is no depth)",
                                unit="m", encoding="zstd")
    K: np.ndarray = array("3 3", "float64", "of the grid of rgb and depth_m", unit="px")
    label: np.ndarray = array("h w", "uint8", "of the last frame: index in AFFORDANCES, BACKGROUND elsewhere", encoding="zstd")
    rate_hz: float = value("frames a second", unit="Hz")
    hotspot: np.ndarray = array("k 3", "float32", "x, y, radius of circles on the last frame where the hand was; k may be 0",
                                unit="px")


@dataclass(frozen=True)
class InteractionTruth(Schema):
    """What was true of a made sequence. It is for measuring, never an input of training."""

    name: str = value("the sequence")
    flow_m: np.ndarray = array("s h w 3", "float32", "motion of the surface seen in frame i until frame i + 1; s = t - 1",
                               unit="m per frame", frame="camera: x right, y down, z forward", encoding="zstd")
    flow_px: np.ndarray = array("s h w 2", "float32", "the same on the image, x then y", unit="px per frame", encoding="zstd")
    valid: np.ndarray = array("s h w", "bool", "where there is a surface; it may be hidden in frame i + 1", encoding="zstd")
    visible: np.ndarray = array("s h w", "bool", "where the surface is also seen in frame i + 1", encoding="zstd")
    depth_m: np.ndarray = array("t h w", "float32", "exact depth, 0 where nothing is", unit="m", encoding="zstd")


@dataclass(frozen=True)
class RenderedInteraction(Schema):
    """A made sequence: what the sensor recorded, as files that are read like any others, and, apart, what was so."""

    files: FileTree = value("one sequence in the layout of SOR3D-AFF (docs/interaction-data.md)")
    truth: InteractionTruth = value("for measuring only")


@dataclass(frozen=True)
class StaticSample(Schema):
    """A picture with affordance labels (UMD, IIT-AFF), for static evaluation."""

    name: str = value("id of the picture, unique in its set")
    source: str = value("umd or iit-aff")
    split: str = value("train, val or test; '' when the source does not say")
    object_type: str = value("as the source says; '' when it does not")
    rgb: np.ndarray = array("h w 3", "uint8", "colours", encoding="zstd")
    depth_m: np.ndarray = array("d h w", "float32", "0 = hole; d = 1, or 0 where the source has no depth", unit="m",
                                encoding="zstd")
    label: np.ndarray = array("h w", "uint8", "index in AFFORDANCES, BACKGROUND elsewhere", encoding="zstd")
    K: np.ndarray = array("k 3 3", "float64", "of the grid of rgb; k = 1, or 0 where the source does not say", unit="px")


@dataclass(frozen=True)
class StaticSet(Schema):
    """Pictures of one source, and what was wrong with those that could not be read."""

    samples: tuple[StaticSample, ...] = value("one at least, by name")
    refused: tuple[str, ...] = value("a sentence for every other picture that was asked for")


@dataclass(frozen=True)
class ActionClip(Schema):
    """Frames of one action (UTKinect), for pre-training."""

    name: str = value("id, unique in its set")
    action: str = value("what is done, in the words of the source")
    rgb: np.ndarray = array("t h w 3", "uint8", "colours", encoding="zstd")
    depth_m: np.ndarray = array("t h w", "float32", "0 = hole; all 0 where the source has no depth", unit="m", encoding="zstd")
