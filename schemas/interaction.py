"""RGB-D interactions with objects (SOR3D-AFF): specifications, clips, ground truth, scene flow, scores."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from schemas.files import FileTree
from schemas.spec import Bundle, Schema, array, value

if TYPE_CHECKING:
    import numpy as np

AFFORDANCES = ("grasp", "cut", "lift", "push", "rotate", "hammer", "squeeze", "paint", "type")
"""the nine affordances of SOR3D-AFF in the paper's order, which labels and results follow; the released code sorts them by name
(CODE_ORDER), and files on disk contain colours, which are independent of the order
"""
BACKGROUND = 9
"""label of background; the last class in the paper and in the released code"""
CODE_ORDER = ("cut", "grasp", "hammer", "lift", "paint", "push", "rotate", "squeeze", "type")
"""classes 0 to 8 of the released code (STCAE)"""
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
"""BGR colours of mask files, as the released code reads them; every other colour is background"""
OBJECT_TYPES = ("ball", "book", "bottle", "brush", "can", "cup", "hammer", "knife", "pitcher", "smartphone", "sponge")
"""object types of the released code: eleven, where the paper counts ten"""


@dataclass(frozen=True)
class InteractionSpec(Schema):
    """Specification of one sequence to render."""

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
    """RGB-D sequence, recorded or rendered, with the label of its last frame. Colour is registered to depth."""

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
    """Ground truth of a rendered sequence, for evaluation only, never an input of training."""

    name: str = value("the sequence")
    flow_m: np.ndarray = array("s h w 3", "float32", "motion of the surface seen in frame i until frame i + 1; s = t - 1",
                               unit="m per frame", frame="camera: x right, y down, z forward", encoding="zstd")
    flow_px: np.ndarray = array("s h w 2", "float32", "the same on the image, x then y", unit="px per frame", encoding="zstd")
    valid: np.ndarray = array("s h w", "bool", "where there is a surface; it may be hidden in frame i + 1", encoding="zstd")
    visible: np.ndarray = array("s h w", "bool", "where the surface is also seen in frame i + 1", encoding="zstd")
    depth_m: np.ndarray = array("t h w", "float32", "exact depth, 0 where nothing is", unit="m", encoding="zstd")


@dataclass(frozen=True)
class RenderedInteraction(Bundle):
    """Rendered sequence: sensor files that are read like recorded ones, and the ground truth."""

    files: FileTree = value("one sequence in the layout of SOR3D-AFF (docs/rgbd/interaction-data.md)")
    truth: InteractionTruth = value("for measuring only")


@dataclass(frozen=True)
class StaticSample(Schema):
    """Image with affordance labels (UMD, IIT-AFF), for static evaluation."""

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
    """Images of one source, and the errors of those that could not be read."""

    samples: tuple[StaticSample, ...] = value("one at least, by name")
    refused: tuple[str, ...] = value("error message of every other selected image")


@dataclass(frozen=True)
class ActionClip(Schema):
    """Frames of one action (UTKinect), for pre-training."""

    name: str = value("id, unique in its set")
    action: str = value("what is done, in the words of the source")
    rgb: np.ndarray = array("t h w 3", "uint8", "colours", encoding="zstd")
    depth_m: np.ndarray = array("t h w", "float32", "0 = hole; all 0 where the source has no depth", unit="m", encoding="zstd")


@dataclass(frozen=True)
class ShownAnswer(Schema):
    """Output of a model for one sequence, kept for figures; m modes as in its InteractionScores."""

    clip: str = value("the sequence")
    rgb: np.ndarray = array("h w 3", "uint8", "its last frame at the size of the model", encoding="zstd")
    truth: np.ndarray = array("h w", "uint8", "index in AFFORDANCES, BACKGROUND elsewhere", encoding="zstd")
    label: np.ndarray = array("m h w", "uint8", "predicted label, likewise", encoding="zstd")
    confidence: np.ndarray = array("m h w", "float16", "probability of that label", encoding="zstd")
    attention: np.ndarray = array("m a b", "float32", "over the latent; a mean of 1, or a sum of 1 where it is not rescaled; "
                                  "a = b = 0 without attention")


@dataclass(frozen=True)
class InteractionScores(Schema):
    """Scores of a model on n sequences in m modes. Pixel counts add up over a set."""

    name: str = value("the model")
    mode: tuple[str, ...] = value("m of: video, static (the last frame alone)")
    clip: tuple[str, ...] = value("the n sequences")
    object_type: tuple[str, ...] = value("of each, what is used")
    affordance: tuple[str, ...] = value("of each, what it is used for: the true action")
    pixels: np.ndarray = array("n m 3 9", "int64", "pixels of every affordance: found and true, found, true")
    region: np.ndarray = array("n m", "int64", "pixels found and true, whichever affordance they are called")
    code: np.ndarray = array("n m 2", "float64", "what the released code calls Jaccard and F1, of every sequence")
    action: np.ndarray = array("n m 9", "float32", "probability of every action")
    shown: tuple[ShownAnswer, ...] = value("some of the sequences, spread over all")


@dataclass(frozen=True)
class FlowScore(Schema):
    """Scene flow errors of one sequence, summed over pixels and frame pairs, so that they add up."""

    name: str = value("the sequence")
    pixels: int = value("whose true motion is known")
    moving: int = value("of these, those that move by a millimetre a frame or more")
    error_m: float = value("sum of end-point errors over pixels", unit="m per frame")
    error_moving_m: float = value("over those that move", unit="m per frame")
    plain_m: float = value("the same of optical flow with the difference of depths", unit="m per frame")
    plain_moving_m: float = value("over those that move", unit="m per frame")
    error_px: float = value("sum of end-point errors on the image over pixels", unit="px per frame")
    error_moving_px: float = value("over those that move", unit="px per frame")
    plain_px: float = value("the same of optical flow alone, as it starts from nothing", unit="px per frame")
    plain_moving_px: float = value("over those that move", unit="px per frame")


@dataclass(frozen=True)
class SceneFlow(Schema):
    """Scene flow of the surface visible in frame i until frame i + 1; s is the number of frames minus one. Never NaN."""

    name: str = value("the clip")
    flow_m: np.ndarray = array("s h w 3", "float16", "motion in space", unit="m per frame",
                               frame="camera: x right, y down, z forward", encoding="zstd")
    flow_px: np.ndarray = array("s h w 2", "float16", "motion on the image, x then y", unit="px per frame", encoding="zstd")
    colour: np.ndarray = array("s h w 3", "uint8", "flow_m, each axis normalised to 0..255", encoding="zstd")
    colour_px: np.ndarray = array("s h w 3", "uint8", "flow_px likewise; the third axis says no motion", encoding="zstd")
    still: np.ndarray = array("6", "uint8", "what no motion looks like: in colour, then in colour_px")
