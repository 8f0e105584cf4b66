"""Describe the parts of an object for tasks: parts a hand must not touch, and parts where it belongs.

Reads   ObjectMesh: name and category; ObjectViews: its images; files of a model (vlm)
Writes  PartDescriptions: for each task the negative and positive parts, reasons, confidence, and whether the role depends on the
        task
Method  `rules` looks category, task and state up in the two tables of the lexicon (lexicon.py and household.py in
        afford/surface/describe) and uses no image; a category outside both is `unknown` and has no parts. `vlm` prompts a local
        vision-language model with the images, `endpoint` one behind an OpenAI-compatible server; both parse its JSON answer.
        Objects of `uses` are described by it
Fails   `rules` never: unknown objects are a valid result. `vlm` and `endpoint` without a model or server, without a required key,
        or when the answer violates the form
Paper   AffordDex, negative affordance: GPT-4V is prompted for one part that should not be touched, independent of the task
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
BACKEND_GPUS = {"vlm": "vlm.device"}
GPU_SHARED = True
BACKEND_TIMEOUT_S = {"vlm": 86400.0}  # reports no progress; hours on a CPU

BACKENDS = {"rules": "afford.surface.describe.household:describe", "vlm": "afford.surface.describe.chat:describe_by_model",
            "endpoint": "afford.surface.describe.chat:describe_by_server"}  # fmt: skip


@dataclass(frozen=True)
class Params:
    """Parameters of `part_describe`."""

    backend: str = "rules"
    """rules, vlm or endpoint"""
    tasks: tuple[str, ...] = ()
    """tasks, e.g. 'cut bread'; empty: the tasks of the lexicon for the category, or any use"""
    uses: tuple[str, ...] = ()
    """uses that replace those of the backend, 'object | task | parts to hold | parts to avoid' each; see --uses"""
    vlm: Vlm = Vlm()
    """parameters of vlm"""
    endpoint: Served = Served()
    """parameters of endpoint"""


def run(mesh: ObjectMesh, views: ObjectViews, params: Params, weights: FileTree | None = None) -> PartDescriptions:
    """Describe an object for its tasks."""
    from afford.common.registry import block, load
    from afford.models.weights import with_local_weights
    from afford.surface.describe.household import uses_of
    from afford.surface.describe.uses import described

    if given := described(mesh, params.uses):
        return PartDescriptions(mesh.name, given)
    describe, own = load(BACKENDS, params.backend), with_local_weights(block(params, params.backend), weights)
    tasks = params.tasks or uses_of(mesh.category) or ("",)
    return PartDescriptions(mesh.name, tuple(describe(mesh, views, task, own) for task in tasks))
