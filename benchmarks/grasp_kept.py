"""Store of the figures of evaluated grasp policies: seeds that were trained separately are merged into one table."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from afford.common.statistics import wilson_interval
from afford.grasping.evaluate import report, result_cells
from afford.grasping.evaluate.recipes import CARRIED, ROWS, STUDENTS
from afford.grasping.evaluate.report import ABOUT
from afford.grasping.evaluate.result_cells import FIGURES, ResultRow
from benchmarks.pages import ROOT
from schemas.grasp import LEVELS
from stages.grasping.grasp_report import Params

KEPT = ROOT / "benchmarks" / "grasp_rows.json"
POOLED = ("succ_low", "succ_high", "succ_sd", "episodes")
"""not means over seeds"""

Kept = dict[str, dict[str, Any]]
"""policy-seeds-level-engine -> the commit that it was trained at, and its figures; seeds are one (1) or, where only their mean is
known, several (0..2)"""


class Known(NamedTuple):
    """Figures of some seeds of one cell."""

    cell: tuple[str, str, str]
    """policy, level, engine"""
    seeds: frozenset[int]
    commit: str
    figures: Mapping[str, float]


def add(kept: Path, scores: Path, commit: str, policies: Collection[str] = ()) -> Kept:
    """Add the figures of a report's scores.json, of the given policies or of all.

    Figures of the same seeds are replaced. A seed that is part of a mean whose other seeds are missing is kept in that mean,
    and reported.
    """
    known: Kept = json.loads(kept.read_text()) if kept.exists() else {}
    told: dict[str, dict[str, float]] = json.loads(scores.read_text())
    fresh: Kept = {name: {"commit": commit, "figures": figures} for name, figures in told.items()
                   if not policies or name.rsplit("-", 3)[0] in policies}  # fmt: skip
    new = read(fresh)
    for name, old in zip(tuple(known), read(known), strict=True):
        same = [one for one in new if one.cell == old.cell and one.seeds & old.seeds]
        if same and old.seeds <= frozenset[int]().union(*(one.seeds for one in same)):
            del known[name]
        for one in same if name in known else ():
            twin = _name(one)
            print(f"{twin}: unchanged in {name}, because not all seeds of that mean were retrained")
            del fresh[twin]
    known |= fresh
    kept.write_text(json.dumps(known, indent=1, sort_keys=True) + "\n")
    return known


def read(known: Kept) -> list[Known]:
    """Return the figures by cell and seeds."""
    out = list[Known]()
    for name, one in known.items():
        policy, seeds, level, engine = name.rsplit("-", 3)
        first, _, last = seeds.partition("..")
        each = frozenset(range(int(first), int(last or first) + 1))
        out.append(Known((policy, level, engine), each, one["commit"], one["figures"]))
    return out


def rows(known: Kept) -> list[ResultRow]:
    """A line for each policy, level and engine over all seeds that are known, in the order of the recipes and levels."""
    found = dict[tuple[str, str, str], list[Known]]()
    for one in read(known):
        found.setdefault(one.cell, []).append(one)
    order = tuple(dict.fromkeys((*Params().rows, *ROWS, *STUDENTS, *sorted(policy for policy, _, _ in found))))
    places = sorted(found, key=lambda cell: (order.index(cell[0]), LEVELS.index(cell[1]), cell[2]))
    return [ResultRow(*cell, merged(found[cell]), sum(len(one.seeds) for one in found[cell]), _planned(cell[0])) for cell in places]


def merged(parts: Sequence[Known]) -> dict[str, float]:
    """Means over seeds, their standard deviation, and the interval of Succ over all episodes."""
    count = [len(one.seeds) for one in parts]
    out = {name: _mean(parts, name) for name, _, _ in FIGURES if name not in POOLED and any(name in one.figures for one in parts)}
    if sum(count) > 1:
        within = sum((k - 1) * one.figures.get("succ_sd", 0.0) ** 2 for k, one in zip(count, parts, strict=True))
        between = sum(k * (one.figures["succ"] - out["succ"]) ** 2 for k, one in zip(count, parts, strict=True))
        out["succ_sd"] = float(np.sqrt((within + between) / (sum(count) - 1)))
    episodes = [round(one.figures["episodes"]) for one in parts]
    won = sum(round(one.figures["succ"] * n) for n, one in zip(episodes, parts, strict=True))
    low, high = wilson_interval(won, sum(episodes))
    return out | {"succ_low": low, "succ_high": high, "episodes": float(sum(episodes))}


def table(known: Kept) -> str:
    """Return the table of all figures with the commits they were trained at, followed by published rows where they exist."""
    found = rows(known)
    commits = ", ".join(dict.fromkeys(_commits(read(known), found)))
    head = f"Trained at the commits {commits}."
    return "\n".join([head, "", *ABOUT, "", *result_cells.row_lines(found), "", *report.same_rows(found)])


def _commits(known: Sequence[Known], found: Sequence[ResultRow]) -> Iterable[str]:
    for row in found:
        yield from (one.commit for one in known if one.cell == (row.policy, row.level, row.engine))


def _mean(parts: Sequence[Known], name: str) -> float:
    have = [one for one in parts if name in one.figures]
    return float(np.average([one.figures[name] for one in have], weights=[len(one.seeds) for one in have]))


def _planned(policy: str) -> int:
    return Params().seeds if policy in {*ROWS, *STUDENTS, CARRIED} else 1


def _name(one: Known) -> str:
    policy, level, engine = one.cell
    return f"{policy}-{min(one.seeds)}-{level}-{engine}"
