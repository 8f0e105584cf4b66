"""Propose masks in every view of an object, each of which may be one part.

Reads   ObjectMesh; ObjectViews of the same mesh; files of a model (sam)
Writes  PartCandidates: masks by view, sorted by quality
Method  `regions` cuts the surface at concave creases and at changes of colour or thickness, merges regions to a hierarchy, and
        projects all of them into every view. `sam` prompts a Segment Anything model with a grid of points (weights needed). No two
        masks of a view have an IoU above `nms_iou`. `grid` does not segment: it returns overlapping windows of six views, for
        baselines
Fails   when views and mesh do not belong together
Paper   AffordDex, negative affordance: SAM on a 16 x 16 grid, non-maximum suppression at IoU 0.7
"""

from __future__ import annotations

from dataclasses import dataclass

from afford.surface.proposals import Regions, Sam, Windows
from schemas.files import FileTree
from schemas.mesh import ObjectMesh, ObjectViews
from schemas.surface import PartCandidates

LIBRARIES = ("numpy", "opencv-python-headless")
BACKEND_LIBRARIES = {"regions": ("numba", "embreex"), "sam": ("torch", "transformers", "safetensors")}
THREADS = 1
MEMORY_GIB = 1.0
BACKEND_MEMORY_GIB = {"sam": 6.0}
BACKEND_GPUS = {"sam": "sam.device"}
GPU_SHARED = True
BACKEND_TIMEOUT_S = {"sam": 86400.0}  # reports no progress; hours on a CPU

BACKENDS = {"regions": "afford.surface.proposals.regions:propose", "sam": "afford.surface.proposals.sam:propose",
            "grid": "afford.surface.proposals.grid:propose"}  # fmt: skip


@dataclass(frozen=True)
class Params:
    """Parameters of `mask_propose`."""

    backend: str = "regions"
    """regions, sam or grid"""
    regions: Regions = Regions()
    """parameters of regions"""
    sam: Sam = Sam()
    """parameters of sam"""
    grid: Windows = Windows()
    """parameters of grid"""


def run(mesh: ObjectMesh, views: ObjectViews, params: Params, weights: FileTree | None = None) -> PartCandidates:
    """Propose part masks in all views."""
    from afford.common.registry import block, load
    from afford.models.weights import with_local_weights

    if views.visible_area.shape != mesh.faces.shape[:1]:
        wanted, got = len(mesh.faces), len(views.visible_area)
        raise ValueError(f"views of {views.name}: expected {wanted} faces as {mesh.name} has, got {got}; render the views again")
    own = with_local_weights(block(params, params.backend), weights)
    found: PartCandidates = load(BACKENDS, params.backend)(mesh, views, own)
    return found
