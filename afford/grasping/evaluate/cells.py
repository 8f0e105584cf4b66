"""Episodes of one policy on one level in one engine, over seeds: the lines of a report."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from afford.common.statistics import wilson_interval
from schemas.episodes import GraspEpisodes, GraspExam
from schemas.grasp import LEVELS

MAIN = "bullet"
"""the engine whose figures have no prefix"""
PCT = 100.0


class Cell(NamedTuple):
    """One policy on one level in one engine, over seeds."""

    policy: str
    level: str
    engine: str
    runs: tuple[GraspEpisodes, ...]
    planned: int = 0
    """how many were to be; 0: those that there are"""

    def mean(self, name: str, successes: bool = False) -> float:
        """Of a figure, over episodes of each seed, then over seeds; NaN where no episode has it."""
        each = [mean_of(one.figure(name), one.figure("success") > 0 if successes else None) for one in self.runs]
        known = [x for x in each if np.isfinite(x)]
        return float(np.mean(known)) if known else float("nan")

    def spread(self, name: str) -> float:
        """Standard deviation over seeds; NaN for one."""
        each = [mean_of(one.figure(name), None) for one in self.runs]
        return float(np.std(each, ddof=1)) if len(each) > 1 else float("nan")

    def depth_mm(self, percent: float) -> float:
        """Percentile over all steps of each seed's episodes in which hand and object touch, then mean over seeds; NaN where they
        never do.
        """
        found = [one.depth_m[np.isfinite(one.depth_m)] for one in self.runs]
        each = [np.percentile(depths, percent) for depths in found if len(depths)]
        return float(1000 * np.mean(each)) if each else float("nan")

    def interval(self) -> tuple[float, float]:
        """Wilson's 95 % interval of Succ, over all episodes."""
        found = np.concatenate([one.figure("success") for one in self.runs])
        return wilson_interval(int(found.sum()), len(found))

    @property
    def missing(self) -> int:
        """How many seeds are not finished."""
        return max(0, self.planned - len(self.runs))

    @property
    def episodes(self) -> int:
        """How many, over all seeds."""
        return sum(len(one.task) for one in self.runs)


def cells(episodes: Sequence[GraspEpisodes], planned: Sequence[GraspExam] = ()) -> list[Cell]:
    """One for each policy, level and engine, in the order in which policies come, levels as in LEVELS; those that were planned
    also where none is finished.
    """
    every: tuple[GraspEpisodes | GraspExam, ...] = (*planned, *episodes)
    policies, levels = dict.fromkeys(one.policy for one in every), dict.fromkeys((*LEVELS, *(one.level for one in every)))
    engines = dict.fromkeys((MAIN, *(one.engine for one in every)))
    wanted = Counter((one.policy, one.level, one.engine) for one in planned)
    keys = product(policies, levels, engines)
    found = [Cell(*key, tuple(one for one in episodes if (one.policy, one.level, one.engine) == key), wanted[key]) for key in keys]
    return [cell for cell in found if cell.runs or cell.planned]


def mean_of(values: np.ndarray, chosen: np.ndarray | None) -> float:
    """Of those that are finite and, where it is given, chosen; NaN where none is."""
    kept = values[np.isfinite(values) & (chosen if chosen is not None else True)]
    return float(kept.mean()) if len(kept) else float("nan")


def number(value: float, digits: int) -> str:
    """In a table; nothing for NaN."""
    return f"{value:.{digits}f}" if np.isfinite(value) else ""
