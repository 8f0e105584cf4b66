"""Episodes of many policies, levels and engines as metrics and tables."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from afford.dataset.files import empty_folder, tree, write_json
from afford.grasp import agreement, report_clips, report_pairs, report_published, report_tasks
from afford.grasp.cells import MAIN, PCT, Cell, cells, number
from afford.report.grasp_curves import write_curves
from afford.training.ablation import done
from schemas.episodes import ClipsFollowed, GraspEpisodes, GraspExam, GraspJudgement, TwoTasks
from schemas.files import FileTree
from schemas.grasp_task import GraspTask
from schemas.training import TrainingLog

PRIOR = "prior"
"""name of the training whose last figures are called hti"""
GROUP = re.compile("^(lambda|transfer)_")


FIGURES: tuple[tuple[str, str, Callable[[Cell], float]], ...] = (
    ("succ", "Succ %", lambda c: PCT * c.mean("success")),
    ("succ_low", "95 %, from", lambda c: PCT * c.interval()[0]),
    ("succ_high", "to", lambda c: PCT * c.interval()[1]),
    ("succ_sd", "sd of seeds", lambda c: PCT * c.spread("success")),
    ("held", "held %", lambda c: PCT * c.mean("held")),
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


def metrics(episodes: Sequence[GraspEpisodes], planned: Sequence[GraspExam] = ()) -> dict[str, float]:
    """Flat; names without an engine are PyBullet's, names without a level those of the training objects. AS is over successes,
    `.all` over all episodes; `seeds` are finished and `unfinished` are not. Rows of a group (lambda_half, transfer_hti) have it as
    their first word (lambda.half)."""
    out = dict[str, float]()
    for cell in cells(episodes, planned):
        row = GROUP.sub(r"\1.", cell.policy)
        prefix = f"{row}." if cell.engine == MAIN else f"{cell.engine}.{row}."
        named = {name: of(cell) / (PCT if name in SHARES else 1.0) for name, _, of in FIGURES if cell.runs}
        named |= {"seeds": float(len(cell.runs)), "unfinished": float(cell.missing)}
        out |= {f"{prefix}{name}.{cell.level}": value for name, value in named.items()}
        if cell.level == "train":
            out |= {f"{prefix}{name}": value for name, value in named.items()}
        steps = f"control_steps.{cell.engine}"
        out[steps] = out.get(steps, 0.0) + sum(one.depth_m.size for one in cell.runs)
    for name in ("penetration_mm.median", "penetration_mm.p95", "mujoco.penetration_mm.median", "mujoco.penetration_mm.p95"):
        of_teacher = name.replace("penetration", "teacher.penetration")
        out |= {name: out[of_teacher]} if of_teacher in out else {}
    return {name: value for name, value in out.items() if np.isfinite(value)}


def markdown(episodes: Sequence[GraspEpisodes], more: Sequence[str] = (), planned: Sequence[GraspExam] = ()) -> str:
    """All cells, those that are not finished marked so, `more` lines, published rows, and the first policy task by task."""
    lines = ["# Grasps", "", "Succ: within 5 cm of the goal at some step; held: at the last. AS: fingertips within 2 cm of a",
             "negative point at the last step. Physics is strict (100 iterations, 480 Hz); policies act by their mean.", "",
             f"| policy | level | engine | {' | '.join(head for _, head, _ in FIGURES)} | seeds |",
             f"|---|---|---|{'--:|' * (len(FIGURES) + 1)}"]  # fmt: skip
    for cell in cells(episodes, planned):
        values = [number(of(cell), _digits(head)) if cell.runs else "" for _, head, of in FIGURES]
        values.append(done(len(cell.runs), cell.planned))
        lines.append(f"| {cell.policy} | {cell.level} | {cell.engine} | {' | '.join(values)} |")
    found, by_task = cells(episodes), report_tasks.tasks(episodes)
    return "\n".join([*lines, "", *report_tasks.uses(found), "", *more, *report_published.lines(found), "", *by_task, ""])


def _digits(head: str) -> int:
    return 2 if "depth" in head or "contact" in head else 0 if head == "n" else 1


def by_row(logs: Sequence[TrainingLog]) -> dict[str, list[TrainingLog]]:
    """Trainings named <row>-<seed> that have curves of episodes -> row: its seeds."""
    out = dict[str, list[TrainingLog]]()
    for log in logs:
        row, _, seed = log.name.rpartition("-")
        if row and seed.isdigit() and any(curve.name.endswith("as_violation_pct") for curve in log.curves):
            out.setdefault(row, []).append(log)
    return out


class Beside(NamedTuple):
    """What was measured beside episodes."""

    logs: Sequence[TrainingLog] = ()
    followed: Sequence[ClipsFollowed] = ()
    pairs: Sequence[TwoTasks] = ()
    sheets: Sequence[FileTree] = ()
    """of the first policy: two_tasks.png"""
    judged: Sequence[GraspJudgement] = ()
    predicted: Sequence[GraspTask] = ()
    """tasks whose N_t was predicted"""
    positives: Sequence[GraspTask] = ()
    """tasks whose A_t was"""
    planned: Sequence[GraspExam] = ()
    """of what was to be played"""


def write(name: str, episodes: Sequence[GraspEpisodes], beside: Beside, scratch: Path) -> FileTree:
    """metrics.json, report.md, curves.png and the first of the sheets; ValueError when nothing was played."""
    if not episodes:
        raise ValueError(f"{name}: expected episodes to report of, got none")
    folder, logs = empty_folder(scratch / name), beside.logs
    last = {f"{'hti' if log.name == PRIOR else f'training.{log.name}'}.{curve.name}": float(curve.value[-1])
            for log in logs for curve in log.curves if len(curve.value)}  # fmt: skip
    compared = report_clips.ablation(episodes, logs)
    marks = {f"{'' if one.engine == MAIN else one.engine + '.'}{one.policy}.hls_vlm": float(one.score.mean())
             for one in beside.judged if len(one.score)}  # fmt: skip
    worth = agreement.metrics(beside.predicted, episodes) | agreement.positive_metrics(beside.positives)
    told = report_clips.tracking(beside.followed) | report_pairs.metrics(beside.pairs)
    more = last | marks | told | compared | worth
    finite = {key: value for key, value in more.items() if np.isfinite(value)}
    write_json(folder / "metrics.json", metrics(episodes, beside.planned) | finite)
    lines = [*report_clips.lines(beside.followed, compared), *report_pairs.lines(beside.pairs),
             *agreement.lines(beside.predicted, episodes), *agreement.positive_lines(beside.positives)]  # fmt: skip
    (folder / "report.md").write_text(markdown(episodes, lines, beside.planned), encoding="utf-8")
    if runs := by_row(logs):
        write_curves(folder / "curves.png", runs)
    for sheet in beside.sheets[:1]:
        for file in sheet.files:
            shutil.copyfile(file.path, folder / file.name)
    return tree(name, folder)
