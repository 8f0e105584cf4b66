"""episodes of many policies -> the report: tables next to the published rows, a flat dict of metrics, curves.

Reads   GraspEpisodes; TrainingLog of the trainings; ClipsFollowed of the prior; TwoTasks of policies, and their sheets;
        GraspJudgement of a policy; GraspTasks with predicted N_t (`predicted`) or A_t (`positives`); GraspExam of all planned
        evaluations, finished or not
Writes  metrics.json (<policy>.<figure>.<level>; with an engine's name in front where that is not PyBullet), scores.json (seed by
        seed), report.md, curves.png, two_tasks.png
Method  means over episodes, then over seeds; Wilson intervals; the teacher compared with rows without a prior
        (hti.*_with, _without, _by_script)
Fails   ValueError without episodes, or when the compared rows were trained for different numbers of steps
Paper   AffordDex, tables of results and ablations
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.episodes import ClipsFollowed, GraspEpisodes, GraspExam, GraspJudgement, TwoTasks
from schemas.files import FileTree
from schemas.grasp import GraspTask
from schemas.spec import Context
from schemas.training import TrainingLog

LIBRARIES = ("numpy", "scipy", "matplotlib", "opencv-python-headless", "pillow", "blake3")
THREADS = 1
MEMORY_GIB = 0.5


@dataclass(frozen=True)
class Params:
    """Parameters of grasp_report."""

    rows: tuple[str, ...] = ("teacher", "no_negative", "student", "naa_only", "neither", "on_script", "on_script_no_negative",
                             "lambda_half", "lambda_double", "positive_truth", "transfer_none", "transfer_hti", "transfer_naa",
                             "transfer_both")
    """grasp_full: rows to train (evaluate/recipes.py); a student follows its teacher; `positive` needs a two-hand model, which is
    trained unless it is cached"""
    seeds: int = 3
    """grasp_full: trainings per row, with seeds 0, 1, ..."""
    engines: tuple[str, ...] = ("bullet", "mujoco")
    """engines in which policies are evaluated"""
    naa: bool = True
    """grasp_full: also evaluate the first teacher on new shapes with predicted N_t; the part scorer is trained unless cached"""


def run(episodes: tuple[GraspEpisodes, ...], logs: tuple[TrainingLog, ...], followed: tuple[ClipsFollowed, ...],
        pairs: tuple[TwoTasks, ...], sheets: tuple[FileTree, ...], judged: tuple[GraspJudgement, ...], params: Params, ctx: Context,
        predicted: tuple[tuple[GraspTask, ...], ...] = (),
        positives: tuple[tuple[GraspTask, ...], ...] = (), planned: tuple[GraspExam, ...] = ()) -> FileTree:  # fmt: skip
    """Write the report of all policies."""
    from afford.grasping.evaluate.report import ReportInputs, write_report

    told, drawn = (tuple(one for some in tasks for one in some) for tasks in (predicted, positives))
    return write_report("grasp", episodes, ReportInputs(logs, followed, pairs, sheets, judged, told, drawn, planned), ctx.scratch)
