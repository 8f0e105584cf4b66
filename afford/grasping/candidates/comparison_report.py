"""Report of a comparison of masks: rates with Wilson intervals, and differences with bootstrap intervals over objects."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from afford.common.statistics import bootstrap_interval, wilson_interval
from schemas.grasp import GraspComparison

RESAMPLES = 2000
SHARES = ("found", "held", "negative_end", "success")
AGAINST = (("affordance", "whole"), ("affordance+N", "whole+N"), ("affordance+N", "whole"), ("affordance+N", "affordance"),
           ("predicted", "whole"), ("predicted+N", "whole"))  # fmt: skip
"""pairs of methods whose difference is reported"""


@dataclass(frozen=True)
class Row:
    """Rate over trials, or difference of two rates, with the ends of its 95 % interval."""

    engine: str
    method: str
    figure: str
    value: float
    low: float
    high: float
    trials: int


def shares(found: Sequence[GraspComparison]) -> Iterator[Row]:
    """Yield the Wilson interval of each figure, method and engine."""
    for engine, method, name in _cells(found):
        values = np.concatenate(_trials(found, engine, method, name))
        yield Row(engine, method, name, float(values.mean()), *wilson_interval(int(values.sum()), len(values)), len(values))


def differences(found: Sequence[GraspComparison], seed: int) -> Iterator[Row]:
    """Yield differences of two methods on the same views of the same objects; the bootstrap resamples whole objects."""
    for engine in found[0].engines:
        for one, other in AGAINST:
            if {one, other} <= set(found[0].methods):
                both = (_trials(found, engine, method, "success") for method in (one, other))
                pairs = [float(a.mean() - b.mean()) for a, b in zip(*both, strict=True)]
                low, high = bootstrap_interval(np.array(pairs)[:, None], RESAMPLES, seed)[:, 0]
                yield Row(engine, f"{one} - {other}", "success", float(np.mean(pairs)), float(low), float(high), len(pairs))


def table(found: Sequence[GraspComparison], seed: int) -> str:
    """Format the report in Markdown: a row for each method and engine, then the differences."""
    rows = list(shares(found))
    lines = ["| masks | engine | IoU | found | held | presses on negative parts | held, and does not |",
             "|---|---|--:|--:|--:|--:|--:|"]  # fmt: skip
    for method in found[0].methods:
        for engine in found[0].engines:
            mine = {row.figure: row for row in rows if (row.engine, row.method) == (engine, method)}
            iou = np.concatenate(_trials(found, engine, method, "iou")).mean()
            lines.append(f"| {method} | {engine} | {iou:.2f} | {' | '.join(_cell(mine[name]) for name in SHARES)} |")
    lines += ["", "| held without pressing | engine | difference, mean over objects |", "|---|---|--:|"]
    lines += [f"| {row.method} | {row.engine} | {_cell(row)} |" for row in differences(found, seed)]
    return "\n".join(lines) + "\n"


def _cell(row: Row) -> str:
    return f"{row.value:.2f} ({row.low:.2f} to {row.high:.2f})"


def _cells(found: Sequence[GraspComparison]) -> Iterator[tuple[str, str, str]]:
    return ((engine, method, name) for engine in found[0].engines for method in found[0].methods for name in SHARES)


def _trials(found: Sequence[GraspComparison], engine: str, method: str, name: str) -> list[np.ndarray]:
    """Return the trials (t * l,) of each object."""
    return [one.figure(name)[one.methods.index(method), one.engines.index(engine)].reshape(-1) for one in found]
