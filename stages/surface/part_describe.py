"""an object, its pictures and tasks -> which parts a hand must not touch, and where it belongs, in words.

Reads   ObjectMesh: its name and what it is; ObjectViews: how it looks; files of a model (vlm)
Writes  PartDescriptions: for each task the negative and positive parts, why, how sure, and whether the task decides it
Method  `rules` looks them up in a table of things, tasks and states (afford/surface/describe/lexicon.py) and looks at no picture;
        a thing that is not in it is `unknown`, and nothing is said of it. `vlm` shows the pictures to a local vision-language
        model, `endpoint` to one behind an OpenAI-compatible server, and reads the JSON that it answers
Fails   `rules` never: an unknown thing is an answer. `vlm` and `endpoint` when there is no model or server, no key where one is
        asked for, or the answer is not what was asked for
Paper   AffordDex, negative affordance: GPT-4V is asked for one part that should not be touched, whatever the task
"""

from __future__ import annotations

from dataclasses import dataclass

from afford.surface.describe import Served, Vlm
from schemas.files import FileTree
from schemas.mesh import ObjectMesh, ObjectViews
from schemas.surface import PartDescriptions

LIBRARIES: tuple[str, ...] = ()
BACKEND_LIBRARIES = {"vlm": ("numpy", "torch", "transformers", "safetensors", "pillow", "opencv-python-headless"),
                     "endpoint": ("numpy", "opencv-python-headless")}  # fmt: skip
THREADS = 1
MEMORY_GIB = 1.0
BACKEND_MEMORY_GIB = {"vlm": 8.0}

BACKENDS = {"rules": "afford.surface.describe.lexicon:describe", "vlm": "afford.surface.describe.vlm:describe",
            "endpoint": "afford.surface.describe.endpoint:describe"}  # fmt: skip


@dataclass(frozen=True)
class Params:
    backend: str = "rules"
    """rules, vlm or endpoint"""
    tasks: tuple[str, ...] = ()
    """what is to be done, e.g. 'cut bread'; none: the tasks of the table for this thing, or any use"""
    vlm: Vlm = Vlm()
    """parameters of vlm"""
    endpoint: Served = Served()
    """parameters of endpoint"""


def run(mesh: ObjectMesh, views: ObjectViews, params: Params, weights: FileTree | None = None) -> PartDescriptions:
    """Describe an object for its tasks."""
    from afford.common.registry import block, load
    from afford.models.weights import with_local_weights
    from afford.surface.describe.lexicon import TASKS, known_category

    describe, own = load(BACKENDS, params.backend), with_local_weights(block(params, params.backend), weights)
    tasks = params.tasks or TASKS.get(known_category(mesh.category), ("",))
    return PartDescriptions(mesh.name, tuple(describe(mesh, views, task, own) for task in tasks))
