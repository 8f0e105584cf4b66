"""episodes of one or more policies on meshes of the user -> a table of all objects, with what was refused and why.

Reads   the names of all meshes of the source (FileTrees without files); BodyTasks of those that were read, and the same at the
        places that were chosen by trial; GraspEpisodes of
        the evaluations, all bodies of one policy in one engine together; TrainingLogs of the adaptation of each body, or none
Writes  FileTree of report.md and metrics.json (<policy>.<engine>.<figure>)
Method  Succ and AS of each object, then means over objects; AS over successes of tasks with N_t
Fails   ValueError without a mesh
Paper   AffordDex, tables of results
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.bodies import BodyTasks
from schemas.episodes import GraspEpisodes
from schemas.files import FileTree
from schemas.spec import Context
from schemas.training import TrainingLog

LIBRARIES = ("numpy", "scipy", "blake3")
THREADS = 1
MEMORY_GIB = 0.5


@dataclass(frozen=True)
class Params:
    """Parameters of body_report."""

    engines: tuple[str, ...] = ("bullet", "mujoco")
    """engines in which policies are evaluated"""
    policies: tuple[str, ...] = ("bodies",)
    """policies that are evaluated: teacher, of flat tools, and bodies, trained further on household bodies; films and adaptation
    are of the last one"""


def run(meshes: tuple[FileTree, ...], bodies: tuple[BodyTasks, ...], episodes: tuple[GraspEpisodes, ...],
        adapted: tuple[TrainingLog, ...], params: Params, ctx: Context, tried: tuple[BodyTasks, ...] = ()) -> FileTree:  # fmt: skip
    """Write the report of all objects; `tried` are the bodies at the places that were chosen by trial."""
    from afford.grasping.evaluate.body_report import write_report

    return write_report("grasp", tuple(one.name for one in meshes), bodies, episodes, ctx.scratch, adapted, tried)
