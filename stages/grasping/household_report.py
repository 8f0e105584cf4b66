"""Episodes of policies on household bodies -> tables by grasp family, pose and category, held-out categories apart.

Reads   BodyTasks of household_tasks; GraspEpisodes of the evaluations, all bodies of one policy in one engine together
Writes  FileTree of report.md and metrics.json (<policy>.<engine>.<table>.<row>.<figure>)
Method  means over episodes; Wilson intervals; AS over successes of tasks with N_t
Fails   ValueError without a body
Paper   AffordDex, tables of results; families and held-out categories are ours
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.bodies import BodyTasks
from schemas.episodes import GraspEpisodes
from schemas.files import FileTree
from schemas.spec import Context

LIBRARIES = ("numpy", "scipy", "numba", "manifold3d", "blake3")
THREADS = 1
MEMORY_GIB = 0.5


@dataclass(frozen=True)
class Params:
    """No parameters."""


def run(bodies: tuple[BodyTasks, ...], episodes: tuple[GraspEpisodes, ...], params: Params, ctx: Context) -> FileTree:
    """Write the report."""
    from afford.grasping.evaluate.household_report import write_report
    from afford.synthetic.objects.household_bodies import HELD_OUT

    return write_report(bodies, episodes, HELD_OUT, ctx.scratch)
