"""Ground truth of a synthetic clip. Only the quality report reads it; no extraction stage does."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from schemas.masks import Entity
from schemas.spec import Schema, array, value

if TYPE_CHECKING:
    import numpy as np


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
