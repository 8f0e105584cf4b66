"""episodes of many policies -> the report: tables beside the published rows, a flat dict of metrics, curves.

Reads   GraspEpisodes; TrainingLog of the trainings
Writes  metrics.json (<policy>.<figure>.<level>; with an engine's name in front where that is not PyBullet), report.md, curves.png
Method  means over episodes, then over seeds; Wilson's intervals
Fails   ValueError when nothing was played
Paper   AffordDex, tables of results and ablations
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.context import Context
from schemas.episodes import GraspEpisodes
from schemas.files import FileTree
from schemas.training import TrainingLog

LIBRARIES = ("numpy", "scipy", "matplotlib", "opencv-python-headless", "pillow", "blake3")
THREADS = 1
MEMORY_GIB = 0.5


@dataclass(frozen=True)
class Params:
    rows: tuple[str, ...] = ("teacher", "no_negative", "student", "naa_only", "neither", "on_script", "on_script_no_negative",
                             "lambda_half", "lambda_double", "transfer_none", "transfer_hti", "transfer_naa", "transfer_both")
    """grasp_full: what is trained (afford/grasp/recipes.py); student comes after its teacher"""
    seeds: int = 3
    """grasp_full: trainings of each row, with the seeds 0, 1, ..."""
    engines: tuple[str, ...] = ("bullet", "mujoco")
    """in which policies are examined"""


def run(episodes: tuple[GraspEpisodes, ...], logs: tuple[TrainingLog, ...], params: Params, ctx: Context) -> FileTree:
    """One report of all policies."""
    from afford.grasp.report import write

    return write("grasp", episodes, logs, ctx.scratch)
