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

from schemas.files import FileTree
from schemas.mesh import ObjectMesh, ObjectViews
from schemas.surface import PartDescriptions

LIBRARIES = ("numpy", "torch", "transformers", "safetensors", "pillow", "opencv-python-headless")
THREADS = 1
MEMORY_GIB = 1.0

BACKENDS = {"rules": "afford.surface.describe.rules:describe", "vlm": "afford.surface.describe.vlm:describe",
            "endpoint": "afford.surface.describe.endpoint:describe"}  # fmt: skip


@dataclass(frozen=True)
class Params:
    backend: str = "rules"
    """rules, vlm or endpoint"""
    tasks: tuple[str, ...] = ()
    """what is to be done, e.g. 'cut bread'; none: the tasks of the table for this thing, or any use"""
    model: str = ""
    """vlm: local folder or hub id; endpoint: what the server calls its model"""
    views: int = 6
    """vlm, endpoint: pictures of the object that are shown, on one sheet"""
    new_tokens: int = 1024
    """vlm, endpoint: longest answer"""
    url: str = ""
    """endpoint: base address of the server, e.g. http://127.0.0.1:8000/v1"""
    key_variable: str = "OPENAI_API_KEY"
    """endpoint: name of the environment variable that holds the key; '' for a server that asks for none"""
    timeout_s: float = 120.0
    """endpoint: longest that a request lasts as a whole, from the connection to the last byte of the reply"""
    retries: int = 3
    """endpoint: further tries when it cannot be reached, is busy or fails"""
    pause_s: float = 1.0
    """endpoint: before the first of them; twice as long before each further one"""
    seed: int = 0
    """endpoint: sent to the server, which may heed it"""
    device: str = "cpu"
    """vlm: cpu, cuda or cuda:N; bytes differ between kinds of device"""
    dtype: str = "float32"
    """vlm: float32, bfloat16 or float16"""

    def __post_init__(self) -> None:
        """What might be a key is not shown, and is refused before anything is written."""
        from afford.models.api_key import harmless

        harmless(self)
        if self.views < 1:
            raise ValueError(f"expected views of 1 or more, got {self.views}")


def run(mesh: ObjectMesh, views: ObjectViews, params: Params, weights: FileTree | None = None) -> PartDescriptions:
    """Describe an object for its tasks."""
    from afford.common.registry import load
    from afford.models.weights import placed
    from afford.surface.describe.lexicon import TASKS
    from afford.surface.describe.rules import known

    describe, params = load(BACKENDS, params.backend), placed(params, weights)
    tasks = params.tasks or TASKS.get(known(mesh.category), ("",))
    return PartDescriptions(mesh.name, tuple(describe(mesh, views, task, params) for task in tasks))
