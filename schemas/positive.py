"""Positive affordances: where on the surface of an object hands belong for a task, as a two-hand model sees it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from schemas.spec import Schema, array, value

if TYPE_CHECKING:
    import numpy as np


@dataclass(frozen=True)
class PositiveAffordance(Schema):
    """Where hands belong for one task."""

    task: str = value("what is to be done")
    probability: np.ndarray = array("f", "float32", "0..1 that a hand belongs on a face")
    hand: np.ndarray = array("2 f", "float32", "the same for the (left, right) hand")
    evidence: np.ndarray = array("f", "float32", "weight of the views that voted on a face; 0: not seen, judged by its neighbours")
    taxonomy: np.ndarray = array("4", "float32", "probabilities of left, right, both_same, both_different; mean over the views")
    A_t: np.ndarray = array("k 3", "float32", "positive points, farthest-point sampled; none where nothing is", unit="m",
                            frame="object")  # fmt: skip


@dataclass(frozen=True)
class PositiveAffordances(Schema):
    """Where hands belong on one object, task by task."""

    name: str = value("id of the object")
    tasks: tuple[PositiveAffordance, ...] = value("in the order of the descriptions")
