"""Results of one policy on one level in one engine, over seeds, as numbers and as table rows.

Tables list every policy, level and engine; further tables split the first policy by use and by task.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np

from afford.common.statistics import wilson_interval
from afford.training.ablation import seeds_cell
from schemas.episodes import GraspEpisodes, GraspExam
from schemas.grasp import LEVELS

MAIN = "bullet"
"""engine whose figures have no prefix"""
PCT = 100.0


class ResultCell(NamedTuple):
    """Episodes of one policy on one level in one engine, over seeds."""

    policy: str
    level: str
    engine: str
    runs: tuple[GraspEpisodes, ...]
    planned: int = 0
    """number of seeds planned; 0: those that exist"""

    def mean(self, name: str, successes: bool = False) -> float:
        """Average a figure over the episodes of each seed, then over seeds; NaN when no episode has it."""
        each = [mean_of(one.figure(name), one.figure("success") > 0 if successes else None) for one in self.runs]
        known = [x for x in each if np.isfinite(x)]
        return float(np.mean(known)) if known else float("nan")

    def spread(self, name: str) -> float:
        """Return the standard deviation over seeds; NaN for one seed."""
        each = [mean_of(one.figure(name), None) for one in self.runs]
        return float(np.std(each, ddof=1)) if len(each) > 1 else float("nan")

    def depth_mm(self, percent: float) -> float:
        """Return a percentile of penetration depth over all contact steps of each seed, then the mean over seeds.

        NaN when hand and object never touch.
        """
        found = [one.depth_m[np.isfinite(one.depth_m)] for one in self.runs]
        each = [np.percentile(depths, percent) for depths in found if len(depths)]
        return float(1000 * np.mean(each)) if each else float("nan")

    def interval(self) -> tuple[float, float]:
        """Return Wilson's 95 % interval of the success rate over all episodes."""
        found = np.concatenate([one.figure("success") for one in self.runs])
        return wilson_interval(int(found.sum()), len(found))

    @property
    def missing(self) -> int:
        """Number of seeds that are not finished."""
        return max(0, self.planned - len(self.runs))

    @property
    def episodes(self) -> int:
        """Number of episodes over all seeds."""
        return sum(len(one.task) for one in self.runs)


def group_cells(episodes: Sequence[GraspEpisodes], planned: Sequence[GraspExam] = ()) -> list[ResultCell]:
    """Group episodes by policy, level and engine, in the order of policies, levels as in LEVELS.

    Planned cells are included even when no seed is finished.
    """
    every: tuple[GraspEpisodes | GraspExam, ...] = (*planned, *episodes)
    policies, levels = dict.fromkeys(one.policy for one in every), dict.fromkeys((*LEVELS, *(one.level for one in every)))
    engines = dict.fromkeys((MAIN, *(one.engine for one in every)))
    wanted = Counter((one.policy, one.level, one.engine) for one in planned)
    keys = product(policies, levels, engines)
    found = [ResultCell(*key, tuple(one for one in episodes if (one.policy, one.level, one.engine) == key), wanted[key])
             for key in keys]  # fmt: skip
    return [cell for cell in found if cell.runs or cell.planned]


def mean_of(values: np.ndarray, chosen: np.ndarray | None) -> float:
    """Average the values that are finite and, if given, chosen; NaN when there are none."""
    kept = values[np.isfinite(values) & (chosen if chosen is not None else True)]
    return float(kept.mean()) if len(kept) else float("nan")


def number(value: float, digits: int) -> str:
    """Format a number for a table; empty for NaN."""
    return f"{value:.{digits}f}" if np.isfinite(value) else ""


FIGURES: tuple[tuple[str, str, Callable[[ResultCell], float]], ...] = (
    ("succ", "Succ %", lambda c: c.mean("success")),
    ("succ_low", "95 %, from", lambda c: c.interval()[0]),
    ("succ_high", "to", lambda c: c.interval()[1]),
    ("succ_sd", "sd of seeds", lambda c: c.spread("success")),
    ("held", "held %", lambda c: c.mean("held")),
    ("hls", "HLS", lambda c: c.mean("hls")),
    ("jerk", "log jerk", lambda c: c.mean("log_jerk")),
    ("as_violation_pct", "AS %, successes", lambda c: c.mean("as_violation_pct", successes=True)),
    ("as_violation_pct.all", "AS %, all", lambda c: c.mean("as_violation_pct")),
    ("as_safe_count", "safe tips", lambda c: c.mean("as_safe_count")),
    ("negative_contact_end", "contact at the end", lambda c: c.mean("negative_contact_end")),
    ("negative_contact_any", "ever", lambda c: c.mean("negative_contact_any")),
    ("penetration_mm.median", "depth mm, median", lambda c: c.depth_mm(50)),
    ("penetration_mm.p95", "p95", lambda c: c.depth_mm(95)),
    ("episodes", "n", lambda c: float(c.episodes)),
)
"""name in metrics, column header, and computation"""
SHARES = ("succ", "succ_low", "succ_high", "succ_sd", "held")
"""percent in tables, shares in metrics"""


class ResultRow(NamedTuple):
    """Table row: one policy on one level in one engine."""

    policy: str
    level: str
    engine: str
    figures: Mapping[str, float]
    """by the names of FIGURES, those that are finite; empty when no seed is finished"""
    seeds: int
    planned: int
    """number of seeds planned"""


def result_rows(found: Sequence[ResultCell]) -> list[ResultRow]:
    """Compute the row of each cell."""
    return [ResultRow(cell.policy, cell.level, cell.engine, _cell_figures(cell), len(cell.runs), cell.planned) for cell in found]


def scores(episodes: Sequence[GraspEpisodes]) -> dict[str, dict[str, float]]:
    """Compute figures seed by seed: policy-seed-level-engine -> figures."""
    return {f"{cell.policy}-{cell.runs[0].seed}-{cell.level}-{cell.engine}": _cell_figures(cell)
            for one in episodes for cell in group_cells([one])}  # fmt: skip


def row_lines(found: Sequence[ResultRow]) -> list[str]:
    """Format all rows as a Markdown table; unfinished rows are marked."""
    return [f"| policy | level | engine | {' | '.join(head for _, head, _ in FIGURES)} | seeds |",
            f"|---|---|---|{'--:|' * (len(FIGURES) + 1)}", *map(_row_line, found)]  # fmt: skip


def _cell_figures(cell: ResultCell) -> dict[str, float]:
    each = {name: of(cell) for name, _, of in FIGURES} if cell.runs else {}
    return {name: value for name, value in each.items() if np.isfinite(value)}


def _row_line(row: ResultRow) -> str:
    shown = [number(row.figures.get(name, np.nan) * (PCT if name in SHARES else 1), _digits(head)) for name, head, _ in FIGURES]
    return f"| {row.policy} | {row.level} | {row.engine} | {' | '.join((*shown, seeds_cell(row.seeds, row.planned)))} |"


def _digits(head: str) -> int:
    return 2 if "depth" in head or "contact" in head else 0 if head == "n" else 1


def use_lines(found: Sequence[ResultCell]) -> list[str]:
    """Format the table of the first policy by use, over all seeds."""
    mine = [cell for cell in found if (cell.policy, cell.engine) == (found[0].policy, found[0].engine)]
    lines = ["## Use by use", "", f"{found[0].policy}, {found[0].engine}, over seeds.", "",
             "| level | use | objects | n | Succ % | sd of seeds | AS %, successes |", "|---|---|--:|--:|--:|--:|--:|"]  # fmt: skip
    each = [(cell, use) for cell in mine for use in sorted({use_of(task) for run in cell.runs for task in run.task})]
    return [*lines, *(_use_line(*one) for one in each)]


def _use_line(cell: ResultCell, use: str) -> str:
    only = cell._replace(runs=tuple(of_use(run, use) for run in cell.runs))
    values = PCT * only.mean("success"), PCT * only.spread("success"), only.mean("as_violation_pct", successes=True)
    things = len({task for run in only.runs for task in run.task})
    return f"| {cell.level} | {use} | {things} | {only.episodes} | {' | '.join(number(value, 1) for value in values)} |"


def use_of(task: str) -> str:
    """Return the use in the name of a GraspTask, object/use."""
    return task.rpartition("/")[2]


def of_use(run: GraspEpisodes, use: str) -> GraspEpisodes:
    """Return the episodes of one use, without traces."""
    kept = np.array([use_of(task) == use for task in run.task])
    task = tuple(task for task in run.task if use_of(task) == use)
    return replace(run, task=task, values=run.values[kept], depth_m=run.depth_m[kept], traces=())


def task_lines(episodes: Sequence[GraspEpisodes]) -> list[str]:
    """Format the table of the first policy by task, training by training."""
    mine = [one for one in episodes if one.policy == episodes[0].policy and one.engine == episodes[0].engine]
    lines = [f"## {episodes[0].policy}, {episodes[0].engine}: task by task", "", "| level | task | n | Succ | AS %, successes |",
             "|---|---|--:|--:|--:|"]  # fmt: skip
    for one in mine:
        for name in dict.fromkeys(one.task):
            rows = np.array([task == name for task in one.task])
            succ = one.figure("success")[rows]
            safe = mean_of(one.figure("as_violation_pct")[rows], succ > 0)
            lines.append(f"| {one.level} | {name} | {rows.sum()} | {PCT * succ.mean():.0f} | {number(safe, 1)} |")
    return lines
