"""an object and tasks -> which parts a hand must not touch, and where it belongs, in words.

Reads   ObjectMesh: its name and what it is
Writes  PartDescriptions: for each task the negative and positive parts, why, how sure, and whether the task decides it
Method  `rules` looks them up in a table of things, tasks and states (afford/backends/describe/lexicon.py); a thing that is not in
        it is `unknown`, and nothing is said of it
Fails   never; an unknown thing is an answer
Paper   AffordDex, negative affordance: GPT-4V is asked for one part that should not be touched, whatever the task
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.mesh import ObjectMesh
from schemas.negative import PartDescriptions

LIBRARIES = ("numpy",)
THREADS = 1
MEMORY_GIB = 0.2

BACKENDS = {"rules": "afford.backends.describe.rules:describe"}


@dataclass(frozen=True)
class Params:
    backend: str = "rules"
    """rules"""
    tasks: tuple[str, ...] = ()
    """what is to be done, e.g. 'cut bread'; none: the tasks of the table for this thing, or any use"""


def run(mesh: ObjectMesh, params: Params) -> PartDescriptions:
    """Describe an object for its tasks."""
    from afford.backends.describe.lexicon import TASKS
    from afford.backends.describe.rules import known
    from afford.registry import load

    describe = load(BACKENDS, params.backend)
    tasks = params.tasks or TASKS.get(known(mesh.category), ("",))
    return PartDescriptions(mesh.name, tuple(describe(mesh.name, mesh.category, task) for task in tasks))
