"""What a training measured: its curves, and what a card tells of them."""

from __future__ import annotations

import numpy as np

from afford.training.curves import at_best, table
from schemas.training import Curve, TrainingLog


def log(best: int) -> TrainingLog:
    """Losses of every step, validation of every second."""
    curves = {"loss": ([1, 2, 3, 4], [9.0, 8.0, 7.0, 6.0]), "val.iou": ([2, 4], [0.5, 0.25]), "val.f": ([4], [0.75])}
    made = (Curve(name, np.array(step, np.int64), np.array(value)) for name, (step, value) in curves.items())
    return TrainingLog("made", tuple(made), best, 4)


def test_a_card_tells_the_validation_of_the_weights_that_were_kept() -> None:
    """Neither losses, nor measures of other steps."""
    assert at_best(log(2)) == {"iou": 0.5} and at_best(log(4)) == {"iou": 0.25, "f": 0.75}
    assert table(at_best(log(4))).splitlines()[2:] == ["| f | 0.750 |", "| iou | 0.250 |"]


def test_a_step_that_was_not_validated_tells_nothing() -> None:
    """And says so."""
    assert at_best(log(3)) == {} and table({}) == "None: the last weights were kept."
