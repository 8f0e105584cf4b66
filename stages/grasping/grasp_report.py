"""episodes of many policies -> the report: tables beside the published rows, a flat dict of metrics, curves.

Reads   GraspEpisodes; TrainingLog of the trainings; ClipsFollowed of the prior; TwoTasks of policies, and their sheets;
        GraspJudgement of a policy; GraspTasks whose N_t (`predicted`) or A_t (`positives`) was predicted, where there are some
        GraspExam of all that was planned, finished or not
Writes  metrics.json (<policy>.<figure>.<level>; with an engine's name in front where that is not PyBullet), scores.json (seed by
        seed), report.md, curves.png, two_tasks.png
Method  means over episodes, then over seeds; Wilson's intervals; the teacher against rows without a prior
        (hti.*_with, _without, _by_script)
Fails   ValueError when nothing was played, or when those two did not learn equally long
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
    rows: tuple[str, ...] = ("teacher", "no_negative", "student", "naa_only", "neither", "on_script", "on_script_no_negative",
                             "lambda_half", "lambda_double", "positive_truth", "transfer_none", "transfer_hti", "transfer_naa",
                             "transfer_both")
    """grasp_full: what is trained (evaluate/recipes.py); student comes after its teacher; `positive` asks for a two-hand model,
    which is trained where there is none"""
    seeds: int = 3
    """grasp_full: trainings of each row, with the seeds 0, 1, ..."""
    engines: tuple[str, ...] = ("bullet", "mujoco")
    """in which policies are examined"""
    naa: bool = True
    """grasp_full: the first teacher is also examined on new shapes with N_t as negative affordances are predicted for them; the
    scorer of parts is trained where there is none"""


def run(episodes: tuple[GraspEpisodes, ...], logs: tuple[TrainingLog, ...], followed: tuple[ClipsFollowed, ...],
        pairs: tuple[TwoTasks, ...], sheets: tuple[FileTree, ...], judged: tuple[GraspJudgement, ...], params: Params, ctx: Context,
        predicted: tuple[tuple[GraspTask, ...], ...] = (),
        positives: tuple[tuple[GraspTask, ...], ...] = (), planned: tuple[GraspExam, ...] = ()) -> FileTree:  # fmt: skip
    """One report of all policies."""
    from afford.grasping.evaluate.report import ReportInputs, write_report

    told, drawn = (tuple(one for some in tasks for one in some) for tasks in (predicted, positives))
    return write_report("grasp", episodes, ReportInputs(logs, followed, pairs, sheets, judged, told, drawn, planned), ctx.scratch)
