"""an object's grasp tasks and what was predicted of it -> the same tasks, told the prediction instead of the truth.

Reads   GraspTasks of one object; the ObjectMesh that was looked at; NegativeAffordances or PositiveAffordances of it, or both
Writes  GraspTasks with N_t (and the parts that it says must not be touched) or A_t as predicted for the use; the truth that a
        policy is judged by stays
Method  matched by the use; a part is told to be negative when more than half of its points are; a prediction without points
        leaves a task without points
Fails   ValueError when object or size are not those of the mesh, or a use was not asked about
Paper   AffordDex: the teacher's N is what NAA says of the object
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.grasp import GraspTask
from schemas.mesh import ObjectMesh
from schemas.surface import NegativeAffordances, PositiveAffordances

LIBRARIES = ("numpy", "scipy")
THREADS = 1
MEMORY_GIB = 0.3


@dataclass(frozen=True)
class Params:
    """Nothing to choose."""


def run(tasks: tuple[GraspTask, ...], mesh: ObjectMesh, params: Params, negatives: NegativeAffordances | None = None,
        positives: PositiveAffordances | None = None) -> tuple[GraspTask, ...]:  # fmt: skip
    """Every task of the object, in order."""
    from afford.grasping.env.task_rules import check_same_object, with_predicted_negative, with_predicted_positive

    for one in tasks:
        check_same_object(one.body, mesh)
    if negatives is not None:
        tasks = tuple(with_predicted_negative(one, negatives) for one in tasks)
    if positives is not None:
        tasks = tuple(with_predicted_positive(one, positives) for one in tasks)
    return tasks
