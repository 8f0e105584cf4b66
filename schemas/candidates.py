"""Where hands could grasp what a depth camera sees: candidates of each hand, best first, with what speaks for them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from schemas.spec import Schema, array, value

if TYPE_CHECKING:
    import numpy as np

TERMS = ("positive", "negative", "antipodal", "centred", "clear", "fit", "upright", "reach")
"""what a score is the weighted geometric mean of, each 0..1 (docs/grasp-candidates.md)"""


@dataclass(frozen=True)
class GraspScene(Schema):
    """One look of a depth camera at a thing, and where its regions are in that picture."""

    name: str = value("id of the look")
    depth_m: np.ndarray = array("h w", "float32", "along the optical axis, 0 where nothing was measured", unit="m", encoding="zstd")
    rgb: np.ndarray = array("h w 3", "uint8", "colour, for pictures only")
    K: np.ndarray = array("3 3", "float64", "pinhole matrix", unit="px")
    region: np.ndarray = array("2 h w", "bool", "where the (left, right) hand belongs", encoding="rle")
    hands: np.ndarray = array("2", "bool", "whether the task takes the (left, right) hand")
    negative: np.ndarray = array("h w", "bool", "pixels that no hand may touch", encoding="rle")
    N_t: np.ndarray = array("k 3", "float64", "further points that no hand may touch", unit="m", frame="camera")


@dataclass(frozen=True)
class HandCandidates(Schema):
    """Grasps of one hand, best first. The frame of a grasp has the axes of the palm's grip (HandModel.R_palm_grip): x along the
    thing, to a right hand's thumb, y out of the back of the hand, z to the fingers; its origin is amid what is held."""

    side: Literal["left", "right"] = value("whose hand")
    T_cam_grasp: np.ndarray = array("n 4 4", "float64", "pose of each grasp", unit="m", frame="camera")
    approach: np.ndarray = array("n 3", "float64", "unit direction in which the hand comes: -y of the grasp", frame="camera")
    width_m: np.ndarray = array("n", "float64", "of what is between thumb and fingers", unit="m")
    tips: np.ndarray = array("n 5 3", "float64", "where thumb, index, middle, ring and little finger end", unit="m", frame="camera")
    score: np.ndarray = array("n", "float64", "0..1, falling")
    terms: np.ndarray = array("n 8", "float64", "what each is made of, in the order of TERMS")


@dataclass(frozen=True)
class GraspCandidates(Schema):
    """All grasps of one look; a hand that the task does not take has none."""

    name: str = value("id of the look")
    hands: tuple[HandCandidates, ...] = value("left, right")
    pair: np.ndarray = array("p 2", "int32", "of a task that takes both: grasps (left, right) that go together, best first")
    pair_score: np.ndarray = array("p", "float64", "0..1, falling")
    up: np.ndarray = array("3", "float64", "normal of what the thing lies on; 0 where none was found", frame="camera")
