"""Scores of the extraction stages on clips with ground truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from schemas.spec import Schema, array, value

if TYPE_CHECKING:
    import numpy as np


@dataclass(frozen=True)
class Score(Schema):
    """One measured quantity of one clip: a sum and a count, so that means over clips weigh every item alike."""

    name: str = value("dotted name, e.g. densify.j.gap15 or baseline.nearest.j.gap15")
    total: float = value("sum over items")
    count: int = value("number of items")


@dataclass(frozen=True)
class ClipScores(Schema):
    """Everything measured on one clip."""

    clip_id: str = value("clip")
    hard: tuple[str, ...] = value("why the clip is hard; empty for a standard clip")
    frames: int = value("number of frames of the clip")
    scores: tuple[Score, ...] = value("by name")
    sheet_jpeg: np.ndarray = array("b", "uint8", "JPEG bytes: frame, masks, inpainted, truth, complete object, affordance")
