"""Masks of hands and objects over time: visible (densified) and complete (amodal)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag
from typing import TYPE_CHECKING, Literal

from schemas.spec import Schema, array, value
from schemas.video import Side

if TYPE_CHECKING:
    import numpy as np


@dataclass(frozen=True)
class Entity(Schema):
    """Hand or object, tracked through a clip."""

    entity_id: str = value("unique in the clip: 'left hand', 'right hand', or the object's name with #n for the n-th of it")
    name: str = value("name as annotated")
    class_id: int = value("EPIC noun class, -1 when unknown")
    role: Literal["hand", "object"] = value("hand or object")
    side: Side = value("hands: left or right; objects: ''")


class TrackFlag(IntFlag):
    """State of one entity in one frame; 0 is out of sight."""

    VISIBLE = 1
    KEY = 2
    """the mask is an annotator's"""
    ENTERING = 4
    """between a key frame without the entity and one with it"""
    LEAVING = 8
    """between a key frame with the entity and one without it"""


@dataclass(frozen=True)
class Tracks(Schema):
    """Visible mask of every entity in every frame."""

    clip_id: str = value("clip")
    entities: tuple[Entity, ...] = value("n entities, hands first (left, right), then objects by entity_id")
    frame: np.ndarray = array("t", "int64", "frame numbers of the data set, ascending")
    masks: np.ndarray = array("n t h w", "bool", "visible pixels; entities do not overlap", encoding="rle")
    confidence: np.ndarray = array("n t", "float32", "0..1; 1 at key frames")
    flags: np.ndarray = array("n t", "uint8", "TrackFlag bits")
    source_frame: np.ndarray = array("n t", "int64", "key frame the mask leans on most, -1 for none")
    distance: np.ndarray = array("n t", "int32", "distance to that key frame, -1 for none", unit="frames")
    contact: np.ndarray = array("2 t", "int16", "entity index that the (left, right) hand touches; -1 none, -2 unknown")
    contact_distance: np.ndarray = array("2 t", "int32", "distance to the key frame that says so, -1 for none", unit="frames")


@dataclass(frozen=True)
class CompleteObjects(Schema):
    """Complete (amodal) mask of every object of `Tracks` that a hand ever touches."""

    clip_id: str = value("clip")
    entities: tuple[Entity, ...] = value("n objects, a subset of Tracks.entities in the same order")
    frame: np.ndarray = array("t", "int64", "frame numbers of the data set, ascending")
    masks: np.ndarray = array("n t h w", "bool", "visible part and the part behind hands", encoding="rle")
    confidence: np.ndarray = array("n t", "float32", "0..1; 1 where nothing hides the object")
