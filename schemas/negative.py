"""Negative affordances: which parts a hand must not touch for a task, as words, as masks of views, and on the surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from schemas.spec import Schema, array, value

if TYPE_CHECKING:
    import numpy as np


@dataclass(frozen=True)
class PartNote(Schema):
    """What is said of one part for a task."""

    part: str = value("name of the part, e.g. blade")
    phrase: str = value("the part in words for an image-text model, e.g. 'the sharp blade of a knife'")
    negative: bool = value("True: a hand must not touch it; False: this is where a hand belongs")
    reason: str = value("why, in a sentence")
    confidence: float = value("0..1")
    task_changes: bool = value("whether another task would turn it round")


@dataclass(frozen=True)
class PartDescription(Schema):
    """What is said of an object and a task."""

    name: str = value("id of the object")
    category: str = value("what the describer takes it for; 'unknown' for an object that it does not know")
    task: str = value("what is to be done, e.g. 'cut bread'; '' for any use")
    notes: tuple[PartNote, ...] = value("negative parts first, then by confidence; none where nothing is known")
    backend: str = value("which describer said so")


@dataclass(frozen=True)
class PartCandidates(Schema):
    """Masks in views that may be parts."""

    name: str = value("id of the object")
    view: np.ndarray = array("m", "int16", "view of each mask")
    masks: np.ndarray = array("m h w", "bool", "pixels of the object only", encoding="rle")
    quality: np.ndarray = array("m", "float32", "0..1, how much the mask stands out as one thing")


@dataclass(frozen=True)
class PartScores(Schema):
    """How well each candidate fits each note of a description."""

    name: str = value("id of the object")
    score: np.ndarray = array("m k", "float32", "probability that candidate m shows the part of note k, 0..1")


@dataclass(frozen=True)
class NegativeAffordance(Schema):
    """Where a hand must not go, on the surface."""

    name: str = value("id of the object")
    task: str = value("what is to be done")
    vertices: np.ndarray = array("v 3", "float32", "of the mesh that was asked about", unit="m", frame="object")
    faces: np.ndarray = array("f 3", "int32", "vertex indices")
    probability: np.ndarray = array("f", "float32", "0..1 that a face is negative")
    evidence: np.ndarray = array("f", "float32", "weight of the views that voted on a face; 0: not seen, judged by its neighbours")
    points: np.ndarray = array("n 3", "float32", "evenly spread over the visible surface", unit="m", frame="object")
    negative: np.ndarray = array("n", "bool", "label of each point")
    N_t: np.ndarray = array("k 3", "float32", "negative points, farthest-point sampled; none when nothing is", unit="m",
                           frame="object")  # fmt: skip


@dataclass(frozen=True)
class DistanceField(Schema):
    """Distance to the nearest negative point, on a grid."""

    name: str = value("id of the object")
    distance_m: np.ndarray = array("x y z", "float32", "at the nodes; infinite when nothing is negative", unit="m", encoding="zstd")
    origin: np.ndarray = array("3", "float64", "node (0, 0, 0)", unit="m", frame="object")
    spacing_m: float = value("between nodes", unit="m")
