"""an object and the lexicon -> its uses as grasp tasks: what to hold, which parts a hand must not touch.

Reads   ObjectSpec, GraspObject
Writes  GraspTask of every use that can be held, at every scale
Method  the lexicon says which parts a use forbids and where the hand belongs; a use is left out when what is
        safe of the part to hold, 2 cm from what is forbidden, is too short or too thick for the hand, or too thin to be lifted off
        a table, and when what is forbidden is far from where one would grasp; N_t are farthest points of the forbidden parts,
        A_t of what is safe of the part to hold
Fails   ValueError for a category that the lexicon does not have, or numbers out of range
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
    scales: tuple[float, ...] = (1.0,)
    """sizes of the object; 1 is as it was built"""
    level: str = ""
    """what these tasks are for (schemas/grasp.py LEVELS); '' takes it from the split of the object"""
    least_length_m: float = 0.07
    """shortest safe stretch of a part that is held"""
    thickness_m: tuple[float, float] = (0.009, 0.06)
    """thinnest and thickest: the second extent across its length"""
    ballast: tuple[float, ...] = (1.0,)
    """how many times as dense as the rest forbidden parts are: 1 is as it was built, 6 a blade of steel on a handle of wood"""
    within_m: float = 0.05
    """farthest that forbidden points may be from the centre of mass along the object: where they are farther, a hand that grasps
    near that centre meets none of them, and the task asks nothing"""


def run(spec: ObjectSpec, body: GraspObject, params: Params) -> tuple[GraspTask, ...]:
    """The tasks of one object; none where no use can be held."""
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
