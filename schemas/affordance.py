"""Where each hand acts on an object, frame by frame, and which hands the task takes."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

from schemas.clip import Narration
from schemas.masks import Entity
from schemas.spec import Schema, array, value

if TYPE_CHECKING:
    import numpy as np


class Taxonomy(IntEnum):
    """2HandedAfforder's four classes in the order of the released one-hot vectors; NONE = no hand in contact."""

    NONE = -1
    LEFT = 0
    RIGHT = 1
    BOTH_SAME = 2
    BOTH_DIFFERENT = 3


TAXONOMY = tuple(one.name.lower() for one in Taxonomy if one is not Taxonomy.NONE)
"""left, right, both_same, both_different: names of the four classes, in their order"""
TAKES = ((True, False), (False, True), (True, True), (True, True))
"""whether each class takes the (left, right) hand"""
MIRRORED = (Taxonomy.RIGHT, Taxonomy.LEFT, Taxonomy.BOTH_SAME, Taxonomy.BOTH_DIFFERENT)
"""each class in a mirror"""


class Rejection(IntEnum):
    """Why a frame gives no sample; ACCEPTED = it does."""

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
    """Left and right affordance mask per frame: complete object AND same-side hand (then dilated when asked)."""

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
    """Which narrations speak of which frames. A frame may have none, or (policy `all`) several."""

    clip_id: str = value("clip")
    narrations: tuple[Narration, ...] = value("n narrations that label at least one frame")
    frame: np.ndarray = array("m", "int64", "frame numbers of the data set, ascending, repeated under policy `all`")
    narration: np.ndarray = array("m", "int32", "index into `narrations`")
    unmatched: tuple[str, ...] = value("narration ids that match no frame of the clip")
    excluded: tuple[str, ...] = value("narration ids dropped because of their verb")
