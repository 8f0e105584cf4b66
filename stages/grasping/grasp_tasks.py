"""an object and the lexicon -> its uses as grasp tasks: the part to hold and the negative parts.

Reads   ObjectSpec, GraspObject
Writes  GraspTask of every use whose part a hand can hold, at every scale
Method  the lexicon names the negative and positive parts of a use. A use is left out when the safe points of the part to hold,
        2 cm from negative parts, are too short or too thick for the hand or too thin to be lifted off a table, or when the negative
        parts are far from the place of a usual grasp. N_t are a farthest point sample of the negative parts, A_t of the safe points
Fails   ValueError for a category that is not in the lexicon, or numbers out of range
Paper   AffordDex: 100 negative points of each object; tasks are ours
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.grasp import GraspObject, GraspTask
from schemas.mesh import ObjectSpec

LIBRARIES = ("numpy", "scipy", "trimesh")
THREADS = 1
MEMORY_GIB = 0.3


@dataclass(frozen=True)
class Params:
    """Parameters of grasp_tasks."""

    scales: tuple[float, ...] = (1.0,)
    """scales of the object; 1 is the built size"""
    level: str = ""
    """level of the tasks (schemas/grasp.py LEVELS); '' takes it from the split of the object"""
    least_length_m: float = 0.07
    """least length of the safe points of the part to hold"""
    thickness_m: tuple[float, float] = (0.009, 0.06)
    """least and largest thickness: the extents across the length"""
    ballast: tuple[float, ...] = (1.0,)
    """density of negative parts relative to the rest: 1 as built, 6 a steel blade on a wooden handle"""
    within_m: float = 0.05
    """largest distance of negative points from the centre of mass along the object; beyond it a usual grasp does not meet them, and
    the task is trivial"""


def run(spec: ObjectSpec, body: GraspObject, params: Params) -> tuple[GraspTask, ...]:
    """Derive the tasks of one object; an empty tuple where no use has a part to hold."""
    from afford.grasping.env.task_rules import scaled, tasks_of

    for field in ("scales", "ballast"):
        if not getattr(params, field) or min(getattr(params, field)) <= 0:
            raise ValueError(f"grasp_tasks.{field}: expected numbers above 0, got {getattr(params, field)}")
    level = params.level or {"train": "train", "val": "val", "seen": "unseen_object", "unseen": "unseen_category"}[spec.split]
    return tuple(one for scale in params.scales for heavy in params.ballast
                 for one in tasks_of(scaled(body, scale), spec.category, level, _label("x", scale) + _label("+", heavy),
                                 params.least_length_m, params.thickness_m, params.within_m, heavy))  # fmt: skip


def _label(mark: str, times: float) -> str:
    return f"{mark}{times:g}" if times != 1.0 else ""
