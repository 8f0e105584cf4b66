"""Project the predictions of a two-hand model to positive affordance on the surface.

Reads   ObjectMesh, ObjectViews and PartDescriptions of one object (only its tasks and category); a model: config.json and
        model.safetensors, as model_train writes them
Writes  PositiveAffordances: for each task the probability of every face, for any hand and for each, and points A_t
Method  the model predicts every view with the task; the likeliest region of each returned hand votes on the faces behind its
        pixels, weighted by the cosine of incidence; unseen faces take the values of their neighbours; A_t is a farthest point
        sample
Fails   when the inputs are not of one object, or the model cannot be read
Paper   2HandedAfforder's predictions, projected on the surface as AffordDex projects its negative ones
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.mesh import ObjectMesh, ObjectViews
from schemas.spec import Context
from schemas.surface import PartDescriptions, PositiveAffordances

LIBRARIES = ("numpy", "opencv-python-headless", "torch", "safetensors", "transformers", "tokenizers", "peft", "scipy", "embreex",
             "blake3")  # fmt: skip
THREADS = 1
MEMORY_GIB = 2.0
GPUS = "device"
GPU_SHARED = True


@dataclass(frozen=True)
class Params:
    """Parameters of `positive_affordance_projection`."""

    threshold: float = 0.35
    """probability above which a face is positive"""
    points: int = 100
    """points of A_t"""
    hands: str = "auto"
    """auto: the predicted taxonomy decides in every view; left, right, both: always these"""
    looks: int = 1
    """2: a second prediction in the crop of a small object; views are filled already"""
    mirror: bool = True
    """average each prediction with that of the mirrored view"""
    seed: int = 0
    """seed of the points"""
    device: str = "cpu"
    """cpu, or cuda for a GPU"""

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not 0 <= self.threshold < 1 or self.points < 1:
            raise ValueError("positive_affordance_projection: expected a threshold of 0 or more and less than 1, and 1 point or "
                             f"more, got {self.threshold:g} and {self.points}")


def run(mesh: ObjectMesh, views: ObjectViews, descriptions: PartDescriptions, model: FileTree, params: Params,
        ctx: Context) -> PositiveAffordances:  # fmt: skip
    """Predict every view, and project the predictions on the surface."""
    from afford.common.files import copy_folder, empty_folder
    from afford.common.text import as_narration
    from afford.surface.positive.project import ProjectionSettings, project
    from afford.twohands.model.predictor import Predictor

    if len(views.visible_area) != len(mesh.faces):
        raise ValueError(f"{mesh.name}: expected views of {len(mesh.faces)} faces, got {len(views.visible_area)}; all inputs must "
                         "be of one object")
    kept = copy_folder(model, "config.json", empty_folder(ctx.scratch / "model"))
    predictor = Predictor(kept, params.device, params.mirror)
    settings = ProjectionSettings(params.threshold, params.points, params.seed)
    out = []
    for n, one in enumerate(descriptions.descriptions):
        narration = as_narration(one.task, mesh.category)
        predictions = [predictor.predict(rgb, narration, params.hands, params.looks) for rgb in views.rgb]
        out.append(project(mesh, views, one.task, predictions, settings))
        ctx.progress(n + 1, len(descriptions.descriptions))
    return PositiveAffordances(mesh.name, tuple(out))
