"""Scores case by case -> one number per method, protocol, group and measure, with the interval that resampling gives.

Names: ``[compat.][masks.][<group>.]<method>.<measure>[.low|.high]``. Without `masks.` it is the cropped set, without a group it
is kitchens; other groups are shift, all, epic, ego4d and those that a benchmark adds.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from afford.common import bootstrap
from afford.dataset.act_affordance import PROTOCOLS
from afford.twohands.benchmark import calibration, compat
from afford.twohands.benchmark.cases import KITCHEN, SHIFT
from schemas.affordance import TAXONOMY
from schemas.benchmark import MethodScores

FIRST = (KITCHEN, SHIFT, "all", "epic", "ego4d")
"""groups in the order of the tables; others follow by name"""


class Row(NamedTuple):
    """One method on one group of cases of one protocol."""

    method: str
    protocol: str
    group: str
    cases: int
    mean: dict[str, float]
    """only measures that apply to a case of the group"""
    low: dict[str, float]
    high: dict[str, float]
    compat: compat.Summary | None

    @property
    def prefix(self) -> str:
        """The name of its measures, without the measure."""
        group = "" if self.group == KITCHEN else f"{self.group}."
        return f"{'' if self.protocol == 'cropped' else 'masks.'}{group}{self.method}"


def groups(scores: Iterable[MethodScores]) -> list[str]:
    """Every group that a case is in, in the order of the tables."""
    seen = {group for one in scores for case in one.groups for group in case}
    return [name for name in FIRST if name in seen] + sorted(seen - set(FIRST))


def rows(scores: tuple[MethodScores, ...], resamples: int, seed: int) -> list[Row]:
    """By protocol, group and method; only those with cases."""
    places = [(protocol, group) for protocol in PROTOCOLS for group in groups(scores)]
    found = (row(one, protocol, group, resamples, seed) for protocol, group in places for one in scores)
    return [one for one in found if one is not None]


def row(one: MethodScores, protocol: str, group: str, resamples: int, seed: int) -> Row | None:
    """The means of a method over a group, None when no case is in it."""
    chosen = members(one, protocol, group)
    if not chosen.any():
        return None
    values = one.values[chosen]
    low, high = bootstrap.interval(values, resamples, seed)
    told = [n for n in range(len(one.measure)) if np.isfinite(values[:, n]).any()]
    mean = {one.measure[n]: float(np.nanmean(values[:, n])) for n in told} | _errors(one, chosen)
    ends = [{one.measure[n]: float(end[n]) for n in told} for end in (low, high)]
    return Row(one.name, protocol, group, int(chosen.sum()), mean, ends[0], ends[1], compat.summary(one.compat[chosen], one.level))


def members(one: MethodScores, protocol: str, group: str) -> np.ndarray:
    """(n,) bool: which cases belong to a group of a protocol."""
    return np.array([said == protocol and group in of for said, of in zip(one.protocol, one.groups, strict=True)], bool)


def _errors(one: MethodScores, chosen: np.ndarray) -> dict[str, float]:
    """Calibration of pixels and of the taxonomy, where the method gives probabilities."""
    out = {"ece": calibration.expected_error(one.reliability[chosen].sum(axis=0))}
    right, sure = (one.values[chosen, one.measure.index(name)] for name in ("taxonomy_accuracy", "taxonomy_confidence"))
    known = np.isfinite(right)
    sums = np.stack([np.ones(known.sum()), sure[known], right[known]])
    out["taxonomy_ece"] = calibration.expected_error(calibration.binned(sure[known], sums))
    return {name: value for name, value in out.items() if np.isfinite(value)}


def metrics(found: Iterable[Row]) -> dict[str, float]:
    """Everything as one flat dict."""
    flat = {name: value for one in found for name, value in _flat(one)}
    return dict(sorted(flat.items()))


def _flat(one: Row) -> Iterator[tuple[str, float]]:
    yield f"{one.prefix}.cases", float(one.cases)
    for end, values in (("", one.mean), (".low", one.low), (".high", one.high)):
        yield from ((f"{one.prefix}.{name}{end}", value) for name, value in values.items())
    if one.compat is not None:
        yield from ((f"compat.{one.prefix}.{name}", float(value)) for name, value in one.compat._asdict().items())


def confusion(one: MethodScores, chosen: np.ndarray) -> np.ndarray | None:
    """(4, 4) cases, true class by row and predicted by column; None for a method that tells no class."""
    known = chosen & (one.taxonomy_true >= 0) & (one.taxonomy_found >= 0)
    if not known.any():
        return None
    size = len(TAXONOMY)
    flat = one.taxonomy_true[known].astype(np.int64) * size + one.taxonomy_found[known]
    return np.bincount(flat, minlength=size * size).reshape(size, size)
