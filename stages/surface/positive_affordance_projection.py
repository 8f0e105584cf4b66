"""an object's views, its tasks in words and a two-hand model -> where on its surface hands belong.

Reads   ObjectMesh, ObjectViews and PartDescriptions of one object (of these only the tasks and what it is); a model: config.json
        and model.safetensors, as model_train writes them
Writes  PositiveAffordances: for each task the probability of every face, for any hand and for each, and points A_t
Method  the model is asked about every view with the task; its likeliest region of each hand that it returns votes on the
        faces behind its pixels, by the angle of sight; faces that nobody saw take the values of their neighbours; A_t by
        farthest-point sampling
Fails   when the inputs are not of one object, or the model cannot be read
Paper   2HandedAfforder's predictions, put on the surface as AffordDex puts its negative ones
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


@dataclass(frozen=True)
class Params:
    threshold: float = 0.35
    """probability above which a face is positive"""
    points: int = 100
    """points of A_t"""
    hands: str = "auto"
    """auto: the taxonomy chooses in every view; left, right, both: always these"""
    looks: int = 1
    """2: a thing that fills little of a view is looked at again in its crop; views are filled already"""
    mirror: bool = True
    """each view is looked at together with its mirror image"""
    seed: int = 0
    """seed of the points"""
    device: str = "cpu"
    """cpu, or cuda for a GPU"""

    def __post_init__(self) -> None:
        """Numbers have ranges."""
        if not 0 <= self.threshold < 1 or self.points < 1:
            raise ValueError("positive_affordance_projection: expected a threshold of 0 or more and less than 1, and 1 point or "
                             f"more, got {self.threshold:g} and {self.points}")


def run(mesh: ObjectMesh, views: ObjectViews, descriptions: PartDescriptions, model: FileTree, params: Params,
        ctx: Context) -> PositiveAffordances:  # fmt: skip
    """Ask about every view, and put the answers on the surface."""
    from afford.common.files import copy_folder, empty_folder
    from afford.surface.positive.project import ProjectionSettings, as_narration, project
    from afford.twohands.model.predictor import Predictor

    if len(views.visible_area) != len(mesh.faces):
        raise ValueError(f"{mesh.name}: expected views of {len(mesh.faces)} faces, got {len(views.visible_area)}; all inputs must "
                         "be of one object")
    kept = copy_folder(model, "config.json", empty_folder(ctx.scratch / "model"))
    predictor = Predictor(kept, params.device, params.mirror)
    wish = ProjectionSettings(params.threshold, params.points, params.seed)
    out = []
    for n, one in enumerate(descriptions.descriptions):
        said = [predictor.predict(rgb, as_narration(one.task, mesh.category), params.hands, params.looks) for rgb in views.rgb]
        out.append(project(mesh, views, one.task, said, wish))
        ctx.progress(n + 1, len(descriptions.descriptions))
    return PositiveAffordances(mesh.name, tuple(out))
