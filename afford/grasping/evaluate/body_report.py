"""Report of a policy on meshes of the user: a table row for each object, what was refused and why, and a flat dict of metrics."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from afford.common.files import empty_folder, tree, write_json
from afford.common.statistics import wilson_interval
from afford.surface.meshes.unidexgrasp import LISTS
from schemas.bodies import BodyTasks
from schemas.episodes import GraspEpisodes
from schemas.files import FileTree
from schemas.training import TrainingLog

UNREAD = "could not be read, or its parts not be found; the failures of the run have the reason"
HEAD = """# Grasps of your meshes

Succ: share of episodes in which the object came within 5 cm of its goal, 20 cm above its place. Held: at the last step. AS:
fingertips within 2 cm of a negative point at the last step, over successes. Negative parts are predicted, not known, so AS is
judged by the prediction; only tasks with N_t have one, and means of AS are over the objects that have such a success. The policy
`bodies` was trained on household bodies, `teacher` on flat tools alone, neither on these. The hand begins over the place of the
grasp family, and the policy is free from there on; once it has gripped and raised the object, the wrist carries it to its goal, and
spare fingers let go of N_t (body_evaluate.carry). Objects whose use is `geometry alone` have no part with a place for a hand: they
are held wherever their shape allows, without N_t. `tried` is the last policy at the places where it did best in a few episodes
beforehand, with other starts; each may be on another part and in another pose. All other rows but `adapted` are at the places, and
in the poses, that the shapes suggest.
"""
TRIED = """The policy played each use at several places beforehand. Rows `tried` and `adapted` are at the best one, which is not the
one that the shape suggests for these uses:"""
ADAPTED = """Scripted grasps that lift the object, found in both engines, were cloned for the tasks in which they are better than
the shipped policy, which acts in all others. Figures are of these tasks, or of all where no script was better, on episodes of
the training. The tables above are of other episodes."""


class BodyRow(NamedTuple):
    """Results of one policy on one object in one engine."""

    name: str
    policy: str
    engine: str
    succ: float
    held: float
    as_pct: float
    """over successes of tasks with N_t; NaN without any"""
    with_negative: int
    """tasks with N_t"""
    tasks: int
    episodes: int


def write_report(name: str, meshes: Sequence[str], bodies: Sequence[BodyTasks], runs: Sequence[GraspEpisodes],
                 scratch: Path, adapted: Sequence[TrainingLog] = (), tried: Sequence[BodyTasks] = ()) -> FileTree:  # fmt: skip
    """Write report.md and metrics.json; `adapted` are the logs of body_adapt, `tried` the bodies of body_choose.

    ValueError without a mesh.
    """
    if not meshes:
        raise ValueError("body_report: expected one mesh or more, got none")
    rows = [row for body in bodies for run in runs if (row := body_row(body, run)) is not None]
    unread = [one for one in meshes if one not in {body.name for body in bodies}]
    root = empty_folder(scratch / "report")
    write_json(root / "metrics.json", metrics(rows, len(meshes), len(unread) + sum(not body.tasks for body in bodies)))
    lines = [HEAD, *_tables(rows), *_splits(rows), *_uses(bodies, runs), *_tried(bodies, tried), *_adapted(adapted),
             *_remarks(bodies, unread)]  # fmt: skip
    (root / "report.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return tree(name, root)


def body_row(body: BodyTasks, run: GraspEpisodes) -> BodyRow | None:
    """Results of the tasks of one body in a run; None where the run has none of them."""
    chosen = np.isin(run.task, [task.name for task in body.tasks])
    if not chosen.any():
        return None
    aware = np.isin(run.task, [task.name for task in body.tasks if len(task.N_t) and task.negative])
    won = run.figure("success") > 0
    judged = run.figure("as_violation_pct")[aware & won]
    return BodyRow(body.name, run.policy, run.engine, float(won[chosen].mean()), float(run.figure("held")[chosen].mean()),
                   float(judged.mean()) if len(judged) else float("nan"),
                   sum(bool(len(task.N_t) and task.negative) for task in body.tasks), len(body.tasks), int(chosen.sum()))


def metrics(rows: Sequence[BodyRow], meshes: int, refused: int) -> dict[str, float]:
    """Return <policy>.<engine>.succ and the like: means over the objects that have a task."""
    out: dict[str, float] = {"objects": float(meshes), "objects_refused": float(refused)}
    for policy, engine in sorted({(row.policy, row.engine) for row in rows}):
        mine = [row for row in rows if (row.policy, row.engine) == (policy, engine)]
        judged = [row.as_pct for row in mine if np.isfinite(row.as_pct)]
        out[f"{policy}.{engine}.succ"] = float(np.mean([row.succ for row in mine]))
        out[f"{policy}.{engine}.held"] = float(np.mean([row.held for row in mine]))
        out[f"{policy}.{engine}.tasks_with_negative"] = float(sum(row.with_negative for row in mine))
        if judged:
            out[f"{policy}.{engine}.as_violation_pct"] = float(np.mean(judged))
    return out


def _tables(rows: Sequence[BodyRow]) -> Iterator[str]:
    yield "| object | policy | engine | Succ % | 95 %, from | to | held % | AS %, successes | tasks with N_t | tasks | episodes |"
    yield "|---|---|---|--:|--:|--:|--:|--:|--:|--:|--:|"
    for row in rows:
        low, high = wilson_interval(round(row.succ * row.episodes), row.episodes)
        AS = f"{row.as_pct:.1f}" if np.isfinite(row.as_pct) else "-"
        yield (f"| {row.name} | {row.policy} | {row.engine} | {100 * row.succ:.1f} | {100 * low:.1f} | {100 * high:.1f} | "
               f"{100 * row.held:.1f} | {AS} | {row.with_negative} | {row.tasks} | {row.episodes} |")
    for policy, engine in sorted({(row.policy, row.engine) for row in rows}):
        mine = [row for row in rows if (row.policy, row.engine) == (policy, engine)]
        judged = [row.as_pct for row in mine if np.isfinite(row.as_pct)]
        counts = (sum(row.with_negative for row in mine), sum(row.tasks for row in mine), sum(row.episodes for row in mine))
        AS = f"{np.mean(judged):.1f} ({len(judged)} objects)" if judged else "-"
        yield (f"| mean of {len(mine)} objects | {policy} | {engine} | {100 * np.mean([row.succ for row in mine]):.1f} | | | "
               f"{100 * np.mean([row.held for row in mine]):.1f} | {AS} | {' | '.join(map(str, counts))} |")


def _splits(rows: Sequence[BodyRow]) -> Iterator[str]:
    """Yield a table of the splits of UniDexGrasp, for objects of its lists."""
    found = dict[tuple[str, str, str], list[BodyRow]]()
    for split, row in product(LISTS.values(), rows):
        if row.name.startswith(f"{split}-"):
            found.setdefault((split, row.policy, row.engine), []).append(row)
    if not found:
        return
    head = "| split | policy | engine | objects | Succ % | held % | AS %, successes |"
    yield from ("", "## By split", "", "Means over objects.", "", head, "|---|---|---|--:|--:|--:|--:|")
    for (split, policy, engine), mine in found.items():
        judged = [row.as_pct for row in mine if np.isfinite(row.as_pct)]
        yield (f"| {split} | {policy} | {engine} | {len(mine)} | {100 * np.mean([row.succ for row in mine]):.1f} | "
               f"{100 * np.mean([row.held for row in mine]):.1f} | {f'{np.mean(judged):.1f}' if judged else '-'} |")


def _uses(bodies: Sequence[BodyTasks], runs: Sequence[GraspEpisodes]) -> Iterator[str]:
    """Yield a table with a row for each task."""
    columns = [f"{run.policy}, {run.engine}" for run in runs]
    unique = list(dict.fromkeys(columns))
    head = f"| task | hold | must not be touched | N_t | family | {' | '.join(unique)} |"
    yield from ("", "## Use by use", "", "Succ %.", "", head, f"|---|---|---|--:|---|{'--:|' * len(unique)}")
    for body in bodies:
        for task, family in zip(body.tasks, body.family, strict=True):
            cells = [_share(task.name, [run for run, name in zip(runs, columns, strict=True) if name == one]) for one in unique]
            yield (f"| {task.name} | {task.hold} | {', '.join(task.negative) or '-'} | {len(task.N_t)} | {family} | "
                   f"{' | '.join(cells)} |")


def _tried(bodies: Sequence[BodyTasks], tried: Sequence[BodyTasks]) -> Iterator[str]:
    """Yield the remarks of body_choose."""
    known = {line for body in bodies for line in body.notes}
    found = [line for body in tried for line in body.notes if line not in known]
    if found:
        yield from ("", "## Places by trial", "", TRIED, "", *(f"- {line}" for line in found))


def _adapted(logs: Sequence[TrainingLog]) -> Iterator[str]:
    """Yield a table of the adaptation of each body that has a task, on the episodes of its training."""
    if not logs:
        return
    yield from ("", "## Adaptation", "", ADAPTED, "", "| object | Succ % as it was | kept | held % as it was | kept | weights |",
                "|---|--:|--:|--:|--:|---|")  # fmt: skip
    for log in logs:
        curve = {one.name: one for one in log.curves}
        if "val.score" in curve:
            cells = [100 * float(curve[f"val.{name}"].value[curve["val.score"].step == step][0])
                     for name in ("success", "held") for step in (0, log.best_step)]  # fmt: skip
            kept = f"round {log.best_step} of {log.steps}" if log.best_step else "the shipped ones: no others were better"
            yield f"| {log.name} | {' | '.join(f'{cell:.1f}' for cell in cells)} | {kept} |"


def _share(task: str, runs: Sequence[GraspEpisodes]) -> str:
    found = np.concatenate([run.figure("success")[np.array(run.task) == task] for run in runs if run.task] or [np.zeros(0)])
    return f"{100 * found.mean():.0f}" if len(found) else "-"


def _remarks(bodies: Sequence[BodyTasks], unread: Sequence[str]) -> Iterator[str]:
    refused = [*(f"{name}: {UNREAD}" for name in unread), *(line for body in bodies for line in body.refused)]
    assumed = [line for body in bodies for line in body.notes]
    for title, lines in (("Refused", refused), ("Assumed", assumed)):
        if lines:
            yield from ("", f"## {title}", "", *(f"- {line}" for line in lines))
