"""Everything that a training measured, as a value."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from afford.training.events import Point
from afford.training.state import State
from schemas.training import Curve, TrainingLog


def log(name: str, state: State) -> TrainingLog:
    """The curves of a training."""
    names = sorted({point.name for point in state.points})
    return TrainingLog(name, tuple(_curve(curve, state.points) for curve in names), state.best_step, state.step)


def _curve(name: str, points: Iterable[Point]) -> Curve:
    own = [point for point in points if point.name == name]
    return Curve(name, np.array([point.step for point in own], np.int64), np.array([point.value for point in own], np.float64))
