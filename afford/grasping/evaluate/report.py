"""Report of grasping: metrics, tables and curves of many policies, levels and engines, compared with AffordDex's figures."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from afford.common.files import empty_folder, tree, write_json
from afford.grasping.evaluate import comparisons, result_cells
from afford.grasping.evaluate.recipes import NO_NEGATIVE, STUDENT, TEACHER
from afford.grasping.evaluate.result_cells import MAIN, PCT, ResultRow, group_cells, number
from afford.grasping.evaluate.training_curves import write_curves
from schemas.episodes import ClipsFollowed, GraspEpisodes, GraspExam, GraspJudgement, TwoTasks
from schemas.files import FileTree
from schemas.grasp import GraspTask
from schemas.training import TrainingLog

SAME: tuple[tuple[str, str, str], ...] = (
    (TEACHER, "state", "AffordDex"),
    ("paper_reward", "state", "AffordDex"),
    ("paper_size", "state", "AffordDex"),
    (STUDENT, "vision", "AffordDex"),
    ("neither", "ablation, state", "none"),
    ("paper_none", "ablation, state", "none"),
    (NO_NEGATIVE, "ablation, state", "HTI"),
    ("paper_hti", "ablation, state", "HTI"),
    ("paper_reward", "ablation, state", "HTI + NAA"),
    ("student_no_negative", "ablation, vision", "two of HTI, distillation, NAA"),
    ("student_no_negative", "ablation, vision", "another two of them"),
    ("lambda_half", "lambda_n", "-5"),
    (TEACHER, "lambda_n", "-10"),
    ("lambda_double", "lambda_n", "-20"),
    ("paper_half", "lambda_n", "-5"),
    ("paper_reward", "lambda_n", "-10"),
    ("paper_double", "lambda_n", "-20"),
)
"""our row, published table and published row. The parts of each row of the vision ablation are unknown; the student without
negative terms is compared with both"""


def published_lines(found: Sequence[ResultRow]) -> list[str]:
    """Format the published rows in Markdown, after a table of rows that both have."""
    return [*same_rows(found), *_published_table()]


def same_rows(found: Sequence[ResultRow]) -> list[str]:
    """Format rows that mean the same; empty when there are none."""
    rows = [_published_line(row, theirs) for row, theirs in same_pairs(found)]
    head = ["## Beside the published", "", "Rows that mean the same, not the same test: objects and physics are others; HLS there",
            "is by a vision-language model, so that the two do not compare. AS of ours over successes.", "",
            "| table | theirs | ours | level | engine | Succ, theirs | ours | HLS, theirs | ours | AS, theirs | ours | seeds |",
            "|---|---|---|---|---|--:|--:|--:|--:|--:|--:|--:|"]  # fmt: skip
    return [*head, *rows, ""] if rows else []


def same_pairs(found: Sequence[ResultRow]) -> Iterator[tuple[ResultRow, Published]]:
    """Yield our row and the published row of its level, in the order of SAME, for rows with figures."""
    for ours, table, row in SAME:
        for theirs in PUBLISHED:
            if (theirs.table, theirs.row) == (table, row):
                yield from ((one, theirs) for one in found if (one.policy, one.level) == (ours, theirs.level) and one.figures)


def _published_line(row: ResultRow, theirs: Published) -> str:
    ours = PCT * row.figures["succ"], *(row.figures.get(name, float("nan")) for name in ("hls", "as_violation_pct"))
    both = zip((theirs.succ, theirs.hls, theirs.as_pct), ours, strict=True)
    values = " | ".join(f"{given:g} | {number(own, 1)}" for given, own in both)
    return f"| {theirs.table} | {theirs.row} | {row.policy} | {row.level} | {row.engine} | {values} | {row.seeds} |"


def _published_table() -> list[str]:
    out = ["## Published", "", "AffordDex, on its objects in Isaac Gym; HLS there by a vision-language model.", "",
           "| table | row | level | Succ | HLS | AS |", "|---|---|---|--:|--:|--:|"]  # fmt: skip
    return out + [f"| {r.table} | {r.row} | {r.level} | {r.succ:g} | {r.hls:g} | {r.as_pct:g} |" for r in PUBLISHED]


class Published(NamedTuple):
    """Row of a published table (AffordDex, arXiv 2508.08896v3): Succ %, HLS, AS."""

    table: str
    row: str
    level: str
    succ: float
    hls: float
    as_pct: float


def _levels(table: str, row: str, *cells: tuple[float, float, float]) -> tuple[Published, ...]:
    return tuple(Published(table, row, level, *cell)
                 for level, cell in zip(("train", "unseen_object", "unseen_category"), cells, strict=True))  # fmt: skip


PUBLISHED: tuple[Published, ...] = (
    *_levels("state", "AffordDex", (89.2, 8.6, 4), (87.7, 8.5, 7), (85.2, 8.1, 9)),
    *_levels("state", "UniDexGrasp++", (87.9, 5.4, 28), (84.3, 5.2, 26), (83.1, 5.0, 27)),
    *_levels("state", "UniDexGrasp", (79.4, 6.9, 12), (74.3, 6.4, 15), (70.8, 6.3, 18)),
    *_levels("vision", "AffordDex", (87.0, 8.3, 10), (82.8, 7.8, 14), (79.2, 8.0, 15)),
    *_levels("vision", "UniDexGrasp++", (85.4, 5.4, 29), (79.6, 5.1, 25), (76.7, 4.8, 28)),
    Published("ablation, state", "none", "train", 85.4, 5.2, 27),
    Published("ablation, state", "HTI", "train", 87.9, 8.2, 22),
    Published("ablation, state", "HTI + NAA", "train", 89.2, 8.6, 4),
    Published("ablation, vision", "two of HTI, distillation, NAA", "train", 85.8, 7.2, 13),
    Published("ablation, vision", "another two of them", "train", 86.9, 8.1, 20),
    Published("lambda_n", "-5", "train", 89.1, 8.5, 16),
    Published("lambda_n", "-10", "train", 89.2, 8.6, 4),
    Published("lambda_n", "-20", "train", 87.1, 8.0, 0),
)
"""the two ticks of each vision row are illegible in our copy of the paper"""


PRIOR = "prior"
"""name of the training whose last figures are called hti"""
GROUP = re.compile("^(lambda|transfer)_")
ABOUT = ("Succ: within 5 cm of the goal at some step; held: at the last. AS: fingertips within 2 cm of a",
         "negative point at the last step. Physics is strict (100 iterations, 480 Hz); policies act by their mean.")  # fmt: skip
"""explanation of the table"""


def metrics(episodes: Sequence[GraspEpisodes], planned: Sequence[GraspExam] = ()) -> dict[str, float]:
    """Compute flat metrics.

    Names without an engine are PyBullet's, names without a level those of the training objects. AS is over successes, `.all` over
    all episodes; `seeds` are finished and `unfinished` are not. Rows of a group (lambda_half, transfer_hti) have the group as
    first word (lambda.half).
    """
    out = dict[str, float]()
    for cell in group_cells(episodes, planned):
        row = GROUP.sub(r"\1.", cell.policy)
        prefix = f"{row}." if cell.engine == MAIN else f"{cell.engine}.{row}."
        named = {**result_cells.result_rows([cell])[0].figures, "seeds": float(len(cell.runs)), "unfinished": float(cell.missing)}
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
    """Format all cells, `more` lines, published rows, and the first policy task by task; unfinished cells are marked."""
    found, table = group_cells(episodes), result_cells.result_rows(group_cells(episodes, planned))
    parts = [["# Grasps", "", *ABOUT, ""], result_cells.row_lines(table), [""], result_cells.use_lines(found), [""], more,
             published_lines(table), [""], result_cells.task_lines(episodes), [""]]  # fmt: skip
    return "\n".join(line for part in parts for line in part)


def logs_by_row(logs: Sequence[TrainingLog]) -> dict[str, list[TrainingLog]]:
    """Group trainings named <row>-<seed> that have curves of episodes: row -> its seeds."""
    out = dict[str, list[TrainingLog]]()
    for log in logs:
        row, _, seed = log.name.rpartition("-")
        if row and seed.isdigit() and any(curve.name.endswith("as_violation_pct") for curve in log.curves):
            out.setdefault(row, []).append(log)
    return out


class ReportInputs(NamedTuple):
    """Further inputs of a report."""

    logs: Sequence[TrainingLog] = ()
    followed: Sequence[ClipsFollowed] = ()
    pairs: Sequence[TwoTasks] = ()
    sheets: Sequence[FileTree] = ()
    """of the first policy: two_tasks.png"""
    judged: Sequence[GraspJudgement] = ()
    predicted: Sequence[GraspTask] = ()
    """tasks with predicted N_t"""
    positives: Sequence[GraspTask] = ()
    """tasks with predicted A_t"""
    planned: Sequence[GraspExam] = ()
    """planned evaluations"""


def write_report(name: str, episodes: Sequence[GraspEpisodes], inputs: ReportInputs, scratch: Path) -> FileTree:
    """Write metrics.json, scores.json, report.md, curves.png and the first of the sheets; ValueError without episodes."""
    if not episodes:
        raise ValueError(f"{name}: no episodes to report")
    folder, logs = empty_folder(scratch / name), inputs.logs
    last = {f"{'hti' if log.name == PRIOR else f'training.{log.name}'}.{curve.name}": float(curve.value[-1])
            for log in logs for curve in log.curves if len(curve.value)}  # fmt: skip
    compared = comparisons.prior_ablation(episodes, logs)
    marks = {f"{'' if one.engine == MAIN else one.engine + '.'}{one.policy}.hls_vlm": float(one.score.mean())
             for one in inputs.judged if len(one.score)}  # fmt: skip
    worth = comparisons.negative_metrics(inputs.predicted, episodes) | comparisons.positive_metrics(inputs.positives)
    tracked = comparisons.tracking_metrics(inputs.followed) | comparisons.pair_metrics(inputs.pairs)
    more = last | marks | tracked | compared | worth
    finite = {key: value for key, value in more.items() if np.isfinite(value)}
    write_json(folder / "metrics.json", metrics(episodes, inputs.planned) | finite)
    write_json(folder / "scores.json", result_cells.scores(episodes))
    lines = [*comparisons.clip_lines(inputs.followed, compared), *comparisons.pair_lines(inputs.pairs),
             *comparisons.negative_lines(inputs.predicted, episodes), *comparisons.positive_lines(inputs.positives)]  # fmt: skip
    (folder / "report.md").write_text(markdown(episodes, lines, inputs.planned), encoding="utf-8")
    if runs := logs_by_row(logs):
        write_curves(folder / "curves.png", runs)
    for sheet in inputs.sheets[:1]:
        for file in sheet.files:
            shutil.copyfile(file.path, folder / file.name)
    return tree(name, folder)
