"""What is to be grasped, for what, and where a hand must not go."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from schemas.grasp import GraspObject
from schemas.spec import Schema, array, value

if TYPE_CHECKING:
    import numpy as np

LEVELS = ("train", "unseen_object", "unseen_size", "unseen_category")
"""objects that a policy learned on; new shapes of their categories; the first in other sizes; other categories"""


@dataclass(frozen=True)
class GraspTask(Schema):
    """One object and one use of it."""

    name: str = value("id, unique among its siblings: object/use")
    level: str = value("one of LEVELS, or '' for an object of the user")
    use: str = value("what is to be done, e.g. cut bread")
    body: GraspObject = value("the object")
    negative: tuple[str, ...] = value("parts that must not be touched, in truth; for judging")
    hold: str = value("part that is to be held; '' for the largest that is not negative")
    N_t: np.ndarray = array("k 3", "float64", "negative points that a policy is shown and rewards look at; none where nothing is",
                            unit="m", frame="object")  # fmt: skip
    told: tuple[str, ...] = value("parts that N_t says must not be touched; those of `negative` where it is the truth")
    A_t: np.ndarray = array("m 3", "float64", "points where hands belong, which rewards may look at; none where none are known",
                            unit="m", frame="object")  # fmt: skip
