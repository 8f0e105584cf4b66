"""an object's grasp tasks and its predicted affordances -> the same tasks with the prediction instead of the truth.

Reads   GraspTasks of one object; the ObjectMesh of the prediction; NegativeAffordances or PositiveAffordances of it, or both
Writes  GraspTasks with predicted N_t (and predicted negative parts) or A_t of their use; the truth for evaluation stays
Method  matched by the use; a part is negative when more than half of its points are; a prediction without points
        leaves a task without points
Fails   ValueError when object or size differ from the mesh, or a use has no prediction
Paper   AffordDex: the teacher's N is predicted by NAA
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
    """No parameters."""


def run(tasks: tuple[GraspTask, ...], mesh: ObjectMesh, params: Params, negatives: NegativeAffordances | None = None,
        positives: PositiveAffordances | None = None) -> tuple[GraspTask, ...]:  # fmt: skip
    """Replace the truth of all tasks of the object, in order."""
    from afford.grasping.env.task_rules import check_same_object, with_predicted_negative, with_predicted_positive

    for one in tasks:
        check_same_object(one.body, mesh)
    if negatives is not None:
        tasks = tuple(with_predicted_negative(one, negatives) for one in tasks)
    if positives is not None:
        tasks = tuple(with_predicted_positive(one, positives) for one in tasks)
    return tasks
