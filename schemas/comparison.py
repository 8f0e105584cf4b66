"""How grasps from different masks went in simulation, trial by trial."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from schemas.spec import Schema, array, value

if TYPE_CHECKING:
    import numpy as np

METHODS = {
    "affordance": "the parts where the hand belongs for the task, in truth",
    "affordance+N": "the same, and the parts that it must not touch",
    "whole": "the whole object",
    "whole+N": "the same, and the parts that a hand must not touch",
    "predicted": "what a two-hand model says of the picture and the task",
    "predicted+N": "the same, and the parts that a hand must not touch",
}
"""which masks grasps come from"""
FIGURES = {
    "found": "a grasp was found",
    "held": "the object is in the hand at the end, lifted by 15 cm within 5 cm; 0 where no grasp was found",
    "negative_end": "the hand presses on a negative part at the end; 0 where nothing is held",
    "negative_any": "it did so at some step",
    "success": "held, and no negative part pressed at the end",
    "score": "of the grasp; 0 where none was found",
    "iou": "of the mask and what is seen of the positive parts",
}
"""of each trial"""


@dataclass(frozen=True)
class GraspComparison(Schema):
    """Trials on one object: m methods, e engines, t tasks, l looks at it in poses of its own."""

    name: str = value("id of the object")
    category: str = value("what it is")
    methods: tuple[str, ...] = value("m of METHODS")
    engines: tuple[str, ...] = value("e of mujoco, bullet")
    tasks: tuple[str, ...] = value("t tasks in words that differ in their parts, and whose positive parts the object has")
    values: np.ndarray = array("m e t l 7", "float64", "figures in the order of FIGURES")

    def figure(self, name: str) -> np.ndarray:
        """(m, e, t, l) of one figure."""
        found: np.ndarray = self.values[..., list(FIGURES).index(name)]
        return found
