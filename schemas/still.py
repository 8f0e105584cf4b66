"""Rendered stills: one picture of things on a table, a task, and every way in which a person might go about it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from schemas.clip import Narration
from schemas.spec import Schema, array, value

if TYPE_CHECKING:
    import numpy as np


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
