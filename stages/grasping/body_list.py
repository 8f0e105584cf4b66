"""tasks of one body with remarks -> the tasks alone, for stages that read tasks.

Reads   BodyTasks
Writes  its GraspTasks
Method  selection of a field
Fails   never
Paper   none
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.bodies import BodyTasks
from schemas.grasp import GraspTask

LIBRARIES: tuple[str, ...] = ()
THREADS = 1
MEMORY_GIB = 0.2


@dataclass(frozen=True)
class Params:
    """No parameters."""


def run(body: BodyTasks, params: Params) -> tuple[GraspTask, ...]:
    """Return the tasks."""
    return tuple(body.tasks)
