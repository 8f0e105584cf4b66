"""Everything that a training measured, as a value; what of it a card tells."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from afford.training.events import Point
from afford.training.state import State
from schemas.training import Curve, TrainingLog


def log(name: str, state: State) -> TrainingLog:
    """The curves of a training."""
    names = sorted({point.name for point in state.points})
    return TrainingLog(name, tuple(_curve(curve, state.points) for curve in names), state.best_step, state.step)


def at_best(curves: TrainingLog) -> dict[str, float]:
    """What validation measured at the step whose weights were kept, by measure; nothing where there was no validation then."""
    return {curve.name.removeprefix("val."): float(curve.value[curve.step == curves.best_step][0])
            for curve in curves.curves if curve.name.startswith("val.") and curves.best_step in curve.step}  # fmt: skip


def table(scores: Mapping[str, float]) -> str:
    """Measures by name as Markdown."""
    if not scores:
        return "None: the last weights were kept."
    return "\n".join(["| measure | value |", "|---|--:|", *(f"| {name} | {value:.3f} |" for name, value in sorted(scores.items()))])


def _curve(name: str, points: Iterable[Point]) -> Curve:
    own = [point for point in points if point.name == name]
    return Curve(name, np.array([point.step for point in own], np.int64), np.array([point.value for point in own], np.float64))
