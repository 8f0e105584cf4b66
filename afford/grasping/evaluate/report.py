"""Episodes of many policies, levels and engines as metrics and tables."""

from __future__ import annotations

import re
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from afford.common.files import empty_folder, tree, write_json
from afford.grasping.evaluate import agreement, report_clips, report_pairs, report_published, report_rows, report_tasks
from afford.grasping.evaluate.cells import MAIN, cells
from afford.grasping.evaluate.grasp_curves import write_curves
from schemas.episodes import ClipsFollowed, GraspEpisodes, GraspExam, GraspJudgement, TwoTasks
from schemas.files import FileTree
from schemas.grasp import GraspTask
from schemas.training import TrainingLog

PRIOR = "prior"
"""name of the training whose last figures are called hti"""
GROUP = re.compile("^(lambda|transfer)_")
ABOUT = ("Succ: within 5 cm of the goal at some step; held: at the last. AS: fingertips within 2 cm of a",
         "negative point at the last step. Physics is strict (100 iterations, 480 Hz); policies act by their mean.")  # fmt: skip
"""what the table is of"""


def metrics(episodes: Sequence[GraspEpisodes], planned: Sequence[GraspExam] = ()) -> dict[str, float]:
    """Flat; names without an engine are PyBullet's, names without a level those of the training objects. AS is over successes,
    `.all` over all episodes; `seeds` are finished and `unfinished` are not. Rows of a group (lambda_half, transfer_hti) have it as
    their first word (lambda.half).
    """
    out = dict[str, float]()
    for cell in cells(episodes, planned):
        row = GROUP.sub(r"\1.", cell.policy)
        prefix = f"{row}." if cell.engine == MAIN else f"{cell.engine}.{row}."
        named = {**report_rows.rows([cell])[0].figures, "seeds": float(len(cell.runs)), "unfinished": float(cell.missing)}
        out |= {f"{prefix}{name}.{cell.level}": value for name, value in named.items()}
        if cell.level == "train":
            out |= {f"{prefix}{name}": value for name, value in named.items()}
        steps = f"control_steps.{cell.engine}"
        out[steps] = out.get(steps, 0.0) + sum(one.depth_m.size for one in cell.runs)
    for name in ("penetration_mm.median", "penetration_mm.p95", "mujoco.penetration_mm.median", "mujoco.penetration_mm.p95"):
        of_teacher = name.replace("penetration", "teacher.penetration")
        out |= {name: out[of_teacher]} if of_teacher in out else {}
    return out


def markdown(episodes: Sequence[GraspEpisodes], more: Sequence[str] = (), planned: Sequence[GraspExam] = ()) -> str:
    """All cells, those that are not finished marked so, `more` lines, published rows, and the first policy task by task."""
    found, table = cells(episodes), report_rows.rows(cells(episodes, planned))
    parts = [["# Grasps", "", *ABOUT, ""], report_rows.lines(table), [""], report_tasks.uses(found), [""], more,
             report_published.lines(table), [""], report_tasks.tasks(episodes), [""]]  # fmt: skip
    return "\n".join(line for part in parts for line in part)


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
    """metrics.json, scores.json, report.md, curves.png and the first of the sheets; ValueError when nothing was played."""
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
    write_json(folder / "scores.json", report_rows.scores(episodes))
    lines = [*report_clips.lines(beside.followed, compared), *report_pairs.lines(beside.pairs),
             *agreement.lines(beside.predicted, episodes), *agreement.positive_lines(beside.positives)]  # fmt: skip
    (folder / "report.md").write_text(markdown(episodes, lines, beside.planned), encoding="utf-8")
    if runs := by_row(logs):
        write_curves(folder / "curves.png", runs)
    for sheet in beside.sheets[:1]:
        for file in sheet.files:
            shutil.copyfile(file.path, folder / file.name)
    return tree(name, folder)
