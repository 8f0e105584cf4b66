"""an object, its parts, tasks and a two-hand model -> grasps from affordance masks compared with grasps from the whole object.

Reads   HandModel; ObjectMesh, MeshParts, GraspObject and PartDescriptions of one object; a model: config.json and
        model.safetensors, as model_train writes them (a tree without files: its rows are left out)
Writes  GraspComparison: for each kind of mask, engine, task and view, success of the grasp and the parts that were touched
Method  the object lies on a table at random and is rendered from the front and above, with noise on its depth; the best candidate
        of each mask is executed by the scripted fingers under strict physics. Masks: the true positive parts, the whole object, and
        the prediction of the model for the image; each without and with the negative parts
Fails   when no task has a positive part of the object, or the object does not come to rest
Paper   2HandedAfforder, robot experiment: grasps from predicted regions against those from whole objects
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.grasp import GraspComparison, GraspObject
from schemas.hand import HandModel
from schemas.mesh import MeshParts, ObjectMesh
from schemas.spec import Context
from schemas.surface import PartDescriptions

LIBRARIES = ("numpy", "scipy", "numba", "opencv-python-headless", "trimesh", "mujoco", "pybullet", "torch", "safetensors",
             "transformers", "tokenizers", "peft", "blake3", "embreex")  # fmt: skip
THREADS = 1
MEMORY_GIB = 2.0


@dataclass(frozen=True)
class Params:
    """Parameters of grasp_compare."""

    engines: tuple[str, ...] = ("mujoco", "bullet")
    """engines in which grasps are executed; the object comes to rest in the first"""
    looks: int = 2
    """poses of the object, each rendered once per task"""
    xy_m: float = 0.05
    """largest distance of the object from the origin, along x and along y; its yaw is random"""
    down_deg: float = 55.0
    """pitch of the camera below the horizontal"""
    noise_m: float = 0.002
    """standard deviation of the depth noise"""
    span_m: float = 0.07
    """largest opening of the scripted fingers"""
    places: int = 48
    """places tried in each region"""
    seed: int = 0
    """seed of poses, table texture and noise"""

    def __post_init__(self) -> None:
        """Check the ranges; engines are checked where they are created."""
        if not self.engines or self.looks < 1 or self.places < 1 or self.span_m <= 0 or self.noise_m < 0:
            raise ValueError(f"grasp_compare: expected an engine, 1 look and place or more, a span above 0 and noise of 0 or more, "
                             f"got {self}")


def run(hand: HandModel, mesh: ObjectMesh, parts: MeshParts, body: GraspObject, descriptions: PartDescriptions, model: FileTree,
        params: Params, ctx: Context) -> GraspComparison:  # fmt: skip
    """Execute all grasps."""
    from afford.grasping.candidates.compare import Subject, Trials, ViewCamera, compare_masks
    from afford.grasping.candidates.find import SearchParams
    from afford.surface.positive.predict import load_region_predictor

    ask = load_region_predictor(model, mesh.category, ctx.scratch / "model") if model.files else None
    camera = ViewCamera(down_deg=params.down_deg, noise_m=params.noise_m)
    search = SearchParams(places=params.places, span_m=params.span_m, count=1)
    trials = Trials(params.engines, params.looks, params.xy_m, camera, search, params.seed)
    return compare_masks(Subject(hand, mesh, parts, body), descriptions, ask, trials)
