"""A line for each policy, level and engine: its figures over seeds, as numbers and as a table."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from afford.grasping.evaluate.cells import PCT, Cell, cells, number
from afford.training.ablation import seeds_cell
from schemas.episodes import GraspEpisodes

FIGURES: tuple[tuple[str, str, Callable[[Cell], float]], ...] = (
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
"""name in metrics, head of the column, and how it is computed"""
SHARES = ("succ", "succ_low", "succ_high", "succ_sd", "held")
"""percent in tables, shares in metrics"""


class Row(NamedTuple):
    """One policy on one level in one engine."""

    policy: str
    level: str
    engine: str
    figures: Mapping[str, float]
    """by the names of FIGURES, those that are finite; none where no seed is finished"""
    seeds: int
    planned: int
    """how many there were to be"""


def rows(found: Sequence[Cell]) -> list[Row]:
    """The line of each cell."""
    return [Row(cell.policy, cell.level, cell.engine, _figures(cell), len(cell.runs), cell.planned) for cell in found]


def scores(episodes: Sequence[GraspEpisodes]) -> dict[str, dict[str, float]]:
    """Seed by seed: policy-seed-level-engine -> its figures."""
    return {f"{cell.policy}-{cell.runs[0].seed}-{cell.level}-{cell.engine}": _figures(cell)
            for one in episodes for cell in cells([one])}  # fmt: skip


def lines(found: Sequence[Row]) -> list[str]:
    """Markdown: a table of all of them, those that are not finished marked so."""
    return [f"| policy | level | engine | {' | '.join(head for _, head, _ in FIGURES)} | seeds |",
            f"|---|---|---|{'--:|' * (len(FIGURES) + 1)}", *map(_line, found)]  # fmt: skip


def _figures(cell: Cell) -> dict[str, float]:
    each = {name: of(cell) for name, _, of in FIGURES} if cell.runs else {}
    return {name: value for name, value in each.items() if np.isfinite(value)}


def _line(row: Row) -> str:
    shown = [number(row.figures.get(name, np.nan) * (PCT if name in SHARES else 1), _digits(head)) for name, head, _ in FIGURES]
    return f"| {row.policy} | {row.level} | {row.engine} | {' | '.join((*shown, seeds_cell(row.seeds, row.planned)))} |"


def _digits(head: str) -> int:
    return 2 if "depth" in head or "contact" in head else 0 if head == "n" else 1
