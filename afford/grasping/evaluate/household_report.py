"""Report of policies on household bodies: tables by grasp family, pose and category; films by family."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from afford.common.files import empty_folder, tree, write_json
from afford.common.statistics import wilson_interval
from afford.grasping.env.families import FAMILIES
from schemas.bodies import BodyTasks
from schemas.episodes import GraspEpisodes
from schemas.files import FileTree
from schemas.grasp import GraspTask

HEAD = """# Grasps of household bodies

Succ: share of episodes in which the object came within 5 cm of its goal, 20 cm above its place. Held: at the last step. AS:
fingertips within 2 cm of a negative point at the last step, over successes of tasks with N_t; parts and N_t are true. Held-out
categories serve evaluations only. A task is a use in a pose (upright, flat, dropped); the hand begins over the place of its grasp
family, and the policy is free from there on.
"""
COLUMNS = "Succ % | 95 %, from | to | held % | AS %, successes | episodes"


class Posed(NamedTuple):
    """Task with what it is counted by."""

    task: GraspTask
    family: str
    pose: str
    held_out: bool


class Cell(NamedTuple):
    """Figures of a group of tasks in one run."""

    succ: float
    held: float
    as_violation_pct: float
    """over successes of tasks with N_t; NaN without any"""
    episodes: int


def write_report(bodies: Sequence[BodyTasks], runs: Sequence[GraspEpisodes], held_out: Collection[str], scratch: Path) -> FileTree:
    """Write report.md and metrics.json. ValueError without a body."""
    if not bodies:
        raise ValueError("household_report: expected one body or more, got none")
    posed = [Posed(task, family, task.name.split("/")[1], task.body.category in held_out)
             for body in bodies for task, family in zip(body.tasks, body.family, strict=True)]  # fmt: skip
    root = empty_folder(scratch / "report")
    refused = [line for body in bodies for line in body.refused]
    figures: dict[str, float] = {"objects": float(len(bodies)), "tasks": float(len(posed)), "tasks_refused": float(len(refused))}
    pages = [HEAD]
    for title, of in GROUPS.items():
        rows = list(_rows(posed, runs, of))
        figures |= {f"{run.policy}.{run.engine}.{title}.{name}.{figure}": value for name, run, _, cell in rows
                    for figure, value in cell._asdict().items() if np.isfinite(value)}  # fmt: skip
        pages += _table(title, rows)
    write_json(root / "metrics.json", figures)
    pages += [*_categories(posed, runs), *(["", "## Refused", "", *(f"- {line}" for line in refused)] if refused else [])]
    (root / "report.md").write_text("\n".join(pages) + "\n", encoding="utf-8")
    return tree("grasp-household", root)


GROUPS: dict[str, Callable[[Posed], str]] = {
    "all": lambda one: "held out" if one.held_out else "others",
    "family": lambda one: one.family,
    "family of held-out categories": lambda one: one.family if one.held_out else "",
    "pose": lambda one: one.pose,
}
"""title -> name of the row that a task counts in, '' for none"""


def _rows(posed: Sequence[Posed], runs: Sequence[GraspEpisodes],
          of: Callable[[Posed], str]) -> Iterator[tuple[str, GraspEpisodes, list[Posed], Cell]]:  # fmt: skip
    """Yield name, run, tasks and figures of each row that has an episode."""
    for name in sorted({of(one) for one in posed} - {""}):
        mine = [one for one in posed if of(one) == name]
        for run in runs:
            if (cell := cell_of(mine, run)) is not None:
                yield name, run, mine, cell


def cell_of(posed: Sequence[Posed], run: GraspEpisodes) -> Cell | None:
    """Compute the figures of some tasks in a run; None where it has none of them."""
    chosen = np.isin(run.task, [one.task.name for one in posed])
    if not chosen.any():
        return None
    aware = np.isin(run.task, [one.task.name for one in posed if len(one.task.N_t)])
    won = run.figure("success") > 0
    judged = run.figure("as_violation_pct")[aware & won]
    return Cell(float(won[chosen].mean()), float(run.figure("held")[chosen].mean()),
                float(judged.mean()) if len(judged) else float("nan"), int(chosen.sum()))  # fmt: skip


def _table(title: str, rows: Sequence[tuple[str, GraspEpisodes, list[Posed], Cell]]) -> Iterator[str]:
    yield from (f"## By {title}" if title != "all" else "## All", "", f"| {title} | policy, engine | objects | tasks | {COLUMNS} |")
    yield "|---|---|--:|--:|--:|--:|--:|--:|--:|--:|"
    for name, run, mine, cell in rows:
        low, high = wilson_interval(round(cell.succ * cell.episodes), cell.episodes)
        AS = f"{cell.as_violation_pct:.1f}" if np.isfinite(cell.as_violation_pct) else "-"
        yield (f"| {name} | {run.policy}, {run.engine} | {len({one.task.body.name for one in mine})} | {len(mine)} | "
               f"{100 * cell.succ:.1f} | {100 * low:.1f} | {100 * high:.1f} | {100 * cell.held:.1f} | {AS} | {cell.episodes} |")
    yield ""


def _categories(posed: Sequence[Posed], runs: Sequence[GraspEpisodes]) -> Iterator[str]:
    """Yield a table with a row for each category."""
    columns = [f"{run.policy}, {run.engine}" for run in runs]
    yield from ("## By category", "", "Succ %.", "",
                f"| category | held out | mass, kg | families | tasks | {' | '.join(columns)} |")  # fmt: skip
    yield f"|---|---|---|---|--:|{'--:|' * len(columns)}"
    for category in sorted({one.task.body.category for one in posed}):
        mine = [one for one in posed if one.task.body.category == category]
        mass = [one.task.body.mass_kg for one in mine]
        families = ", ".join(name for name in FAMILIES if name in {one.family for one in mine})
        cells = [f"{100 * cell.succ:.0f}" if (cell := cell_of(mine, run)) is not None else "-" for run in runs]
        yield (f"| {category.replace('_', ' ')} | {'yes' if mine[0].held_out else ''} | {min(mass):.2f} to {max(mass):.2f} | "
               f"{families} | {len(mine)} | {' | '.join(cells)} |")


def by_family(bodies: Sequence[BodyTasks], run: GraspEpisodes, shown: int) -> tuple[GraspEpisodes, ...]:
    """Select the recorded episodes of each family, at most `shown` each, of as many categories as there are."""
    of_task = {task.name: (family, task.body.category) for body in bodies
               for task, family in zip(body.tasks, body.family, strict=True)}  # fmt: skip
    out = list[GraspEpisodes]()
    for family in FAMILIES:
        traces = [trace for trace in run.traces if of_task[trace.task][0] == family]
        seen = dict[str, int]()
        turn = list[tuple[int, int]]()
        for number, trace in enumerate(traces):
            category = of_task[trace.task][1]
            turn.append((seen.setdefault(category, 0), number))
            seen[category] += 1
        chosen = sorted(number for _, number in sorted(turn)[:shown])
        if chosen:
            out.append(replace(run, name=f"{family}-{run.engine}", traces=tuple(traces[number] for number in chosen)))
    return tuple(out)
