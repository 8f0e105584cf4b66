"""Lists of objects to be grasped, as benchmarks of dexterous grasping publish them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from schemas.spec import Schema, array, value

if TYPE_CHECKING:
    import numpy as np

SPLITS = ("train", "unseen_objects", "unseen_categories")
"""to learn from; new objects of the same categories; objects of other categories"""


@dataclass(frozen=True)
class GraspObjects(Schema):
    """Objects in their sizes and splits; an object of three sizes has three rows."""

    name: str = value("of the list")
    code: tuple[str, ...] = value("n ids, e.g. core/bottle-1a2b, sorted within a split")
    category: tuple[str, ...] = value("n categories, e.g. bottle")
    split: tuple[str, ...] = value("n of SPLITS")
    scale: np.ndarray = array("n", "float64", "what the unit mesh is multiplied with", unit="m")
