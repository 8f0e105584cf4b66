"""Affordance on the surface of a mesh: parts, their descriptions and scores, negative and positive affordance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from schemas.spec import Schema, array, value

if TYPE_CHECKING:
    import numpy as np

@dataclass(frozen=True)
class PartNote(Schema):
    """Description of one part for a task."""

    part: str = value("name of the part, e.g. blade")
    phrase: str = value("the part in words for an image-text model, e.g. 'the sharp blade of a knife'")
    role: Literal["negative", "positive", "neutral"] = value("a hand must not touch it; belongs there; or may, but need not")
    reason: str = value("why, in a sentence; '' for neutral parts")
    confidence: float = value("0..1")
    task_changes: bool = value("whether another task would turn it round")


@dataclass(frozen=True)
class PartDescription(Schema):
    """Description of an object's parts for one task."""

    name: str = value("id of the object")
    category: str = value("what the describer takes it for; 'unknown' for an object that it does not know")
    task: str = value("what is to be done, e.g. 'cut bread'; '' for any use")
    notes: tuple[PartNote, ...] = value("all parts that the describer knows of it; none where it knows nothing")
    backend: str = value("describer backend")


@dataclass(frozen=True)
class PartDescriptions(Schema):
    """Descriptions of an object's parts, one per task."""

    name: str = value("id of the object")
    descriptions: tuple[PartDescription, ...] = value("one for each task")

    @property
    def notes(self) -> tuple[PartNote, ...]:
        """Return all notes in order."""
        return tuple(note for one in self.descriptions for note in one.notes)


@dataclass(frozen=True)
class PartCandidates(Schema):
    """Masks in views that may be parts."""

    name: str = value("id of the object")
    view: np.ndarray = array("m", "int16", "view of each mask")
    masks: np.ndarray = array("m h w", "bool", "pixels of the object only", encoding="rle")
    quality: np.ndarray = array("m", "float32", "0..1, how much the mask stands out as one thing")


@dataclass(frozen=True)
class PartScores(Schema):
    """Score of each part candidate for each note of a description."""

    name: str = value("id of the object")
    share: np.ndarray = array("m k", "float32", "which share of candidate m shows the part of note k of PartDescriptions.notes")
    overlap: np.ndarray = array("m k", "float32", "how well candidate m is that part as its view shows it (IoU), 0..1")


@dataclass(frozen=True)
class PartLessons(Schema):
    """Training data of the part scorer from one object: part candidates with their features and true parts."""

    name: str = value("id of the object")
    category: str = value("what it is")
    split: str = value("train or val")
    parts: tuple[str, ...] = value("p names of its parts")
    crops: np.ndarray = array("m 2 c s s", "uint8", "each candidate close by and in the whole view (score/samples.py)",
                              encoding="zstd")  # fmt: skip
    traits: np.ndarray = array("m r", "float32", "numbers that come with it")
    share: np.ndarray = array("m p", "float32", "which share of its pixels shows each part")
    overlap: np.ndarray = array("m p", "float32", "IoU of it and the visible part in its view")


@dataclass(frozen=True)
class DistanceField(Schema):
    """Distance to the nearest negative point, on a grid."""

    name: str = value("id of the object")
    distance_m: np.ndarray = array("x y z", "float32", "at the nodes; infinite when nothing is negative", unit="m", encoding="zstd")
    origin: np.ndarray = array("3", "float64", "node (0, 0, 0)", unit="m", frame="object")
    spacing_m: float = value("between nodes", unit="m")


@dataclass(frozen=True)
class NegativeAffordance(Schema):
    """Negative affordance of one task: surface regions that a hand must not touch."""

    task: str = value("what is to be done")
    probability: np.ndarray = array("f", "float32", "0..1 that a face is negative")
    evidence: np.ndarray = array("f", "float32", "weight of the views that voted on a face; 0: inferred from its neighbours")
    negative: np.ndarray = array("n", "bool", "label of each point of the object")
    N_t: np.ndarray = array("k 3", "float32", "negative points, farthest-point sampled; none when nothing is", unit="m",
                           frame="object")  # fmt: skip
    field: DistanceField = value("how far places are from N_t")


@dataclass(frozen=True)
class NegativeAffordances(Schema):
    """Negative affordances of one object, one per task."""

    name: str = value("id of the object")
    points: np.ndarray = array("n 3", "float32", "evenly spread over the visible surface", unit="m", frame="object")
    tasks: tuple[NegativeAffordance, ...] = value("in the order of the descriptions")


@dataclass(frozen=True)
class NegativeScore(Schema):
    """Score of one method on one object and task."""

    method: str = value("afford, or a baseline")
    task: str = value("what is to be done")
    iou: float = value("of the negative surface, weighted by visible area; NaN where in truth nothing is negative")
    precision: float = value("share of the predicted surface that is truly negative; 0 without a prediction; NaN as iou")
    recall: float = value("share of the truly negative surface that is predicted; NaN as iou")
    point_recall: float = value("the same, of the object's points, counted; NaN as iou")
    said: float = value("share of the visible surface predicted as negative")
    whole_object_taken: float = value("share of six views where the mask taken holds at least 0.9 of what is seen of the object; "
                                      "NaN where no mask was taken, or the method takes none")  # fmt: skip


@dataclass(frozen=True)
class NegativeScores(Schema):
    """Scores of all methods on one object."""

    name: str = value("id of the object")
    category: str = value("what it is")
    split: str = value("seen or unseen")
    look: str = value("mixed or plain")
    seen_six: float = value("share of the visible surface that six views saw well")
    seen_all: float = value("the same, of all views")
    rows: tuple[NegativeScore, ...] = value("by method and task")
    picture: np.ndarray = array("b", "uint8", "JPEG bytes: six views, red where a hand must not go for the first task")


@dataclass(frozen=True)
class PositiveAffordance(Schema):
    """Positive affordance of one task: surface regions for the hands."""

    task: str = value("what is to be done")
    probability: np.ndarray = array("f", "float32", "0..1 that a hand belongs on a face")
    hand: np.ndarray = array("2 f", "float32", "the same for the (left, right) hand")
    evidence: np.ndarray = array("f", "float32", "weight of the views that voted on a face; 0: inferred from its neighbours")
    taxonomy: np.ndarray = array("4", "float32", "probabilities of left, right, both_same, both_different; mean over the views")
    A_t: np.ndarray = array("k 3", "float32", "positive points, farthest-point sampled; none where nothing is", unit="m",
                            frame="object")  # fmt: skip


@dataclass(frozen=True)
class PositiveAffordances(Schema):
    """Positive affordances of one object, one per task."""

    name: str = value("id of the object")
    tasks: tuple[PositiveAffordance, ...] = value("in the order of the descriptions")
