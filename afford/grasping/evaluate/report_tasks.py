"""The first policy in the first engine, use by use and task by task."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from afford.grasping.evaluate.cells import PCT, Cell, mean_of, number
from schemas.episodes import GraspEpisodes


def uses(found: Sequence[Cell]) -> list[str]:
    """What things are for, over all seeds."""
    mine = [cell for cell in found if (cell.policy, cell.engine) == (found[0].policy, found[0].engine)]
    lines = ["## Use by use", "", f"{found[0].policy}, {found[0].engine}, over seeds.", "",
             "| level | use | objects | n | Succ % | sd of seeds | AS %, successes |", "|---|---|--:|--:|--:|--:|--:|"]  # fmt: skip
    each = [(cell, use) for cell in mine for use in sorted({use_of(task) for run in cell.runs for task in run.task})]
    return [*lines, *(_line(*one) for one in each)]


def _line(cell: Cell, use: str) -> str:
    only = cell._replace(runs=tuple(of_use(run, use) for run in cell.runs))
    values = PCT * only.mean("success"), PCT * only.spread("success"), only.mean("as_violation_pct", successes=True)
    things = len({task for run in only.runs for task in run.task})
    return f"| {cell.level} | {use} | {things} | {only.episodes} | {' | '.join(number(value, 1) for value in values)} |"


def use_of(task: str) -> str:
    """The second half of the name of a GraspTask, object/use."""
    return task.rpartition("/")[2]


def of_use(run: GraspEpisodes, use: str) -> GraspEpisodes:
    """The episodes of one use alone, without traces."""
    kept = np.array([use_of(task) == use for task in run.task])
    task = tuple(task for task in run.task if use_of(task) == use)
    return replace(run, task=task, values=run.values[kept], depth_m=run.depth_m[kept], traces=())


def tasks(episodes: Sequence[GraspEpisodes]) -> list[str]:
    """Every task, training by training."""
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
