"""an object and its views -> masks in every view that may be one part.

Reads   ObjectMesh; ObjectViews of the same mesh; files of a model (sam)
Writes  PartCandidates: masks by view, the most striking first
Method  `regions` cuts the surface where it bends inwards, changes colour or thickness, merges regions of all scales and shows them
        in every view; `sam` asks a Segment Anything model at a grid of points (weights needed). No two masks of a view overlap by
        more than `nms_iou`. `grid` does not segment: overlapping windows over six views, on which baselines stand
Fails   when views and mesh do not fit together
Paper   AffordDex, negative affordance: SAM on a 16 x 16 grid, non-maximum suppression at IoU 0.7
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.mesh import ObjectMesh, ObjectViews
from schemas.surface import PartCandidates

LIBRARIES = ("numpy", "numba", "opencv-python-headless", "embreex", "torch", "transformers", "safetensors")
THREADS = 1
MEMORY_GIB = 1.0

BACKENDS = {"regions": "afford.surface.candidates.regions:propose", "sam": "afford.surface.candidates.sam:propose",
            "grid": "afford.surface.candidates.grid:propose"}  # fmt: skip


@dataclass(frozen=True)
class Params:
    backend: str = "regions"
    """regions, sam or grid"""
    model: str = ""
    """sam: folder or hub id of a SamModel"""
    grid: int = 16
    """sam: points along each side of a view; 32 in the released code"""
    least_iou: float = 0.88
    """sam: IoU that the model predicts for a mask"""
    least_stability: float = 0.7
    """sam: IoU of a mask cut a little above and below its threshold"""
    nms_iou: float = 0.7
    """regions, sam: of two masks of a view that overlap more, the better one is kept"""
    most: int = 20
    """regions, sam: masks of a view"""
    least_share: float = 0.004
    """regions: of the object's area, for a part"""
    most_share: float = 0.95
    """regions, sam: of the object's area or of what a view shows of it, for a part"""
    least_px: int = 60
    """regions, sam: pixels of a mask"""
    windows: int = 6
    """grid: windows along each side of the square around the silhouette; they overlap by half"""
    least_window: float = 0.02
    """grid: of what a view shows of the object, in a window"""
    offset: float = 0.7
    """sam: how far above and below the threshold a mask is cut to see whether it is stable, logits"""
    batch: int = 64
    """sam: points in one pass; 0.3 GB at the published sizes"""
    device: str = "cpu"
    """sam: cpu, cuda or cuda:N; bytes differ between kinds of device"""
    dtype: str = "float32"
    """sam: float32, bfloat16 or float16"""


def run(mesh: ObjectMesh, views: ObjectViews, params: Params, weights: FileTree | None = None) -> PartCandidates:
    """Propose parts."""
    from afford.common.registry import load
    from afford.models.weights import placed

    if views.visible_area.shape != mesh.faces.shape[:1]:
        wanted, got = len(mesh.faces), len(views.visible_area)
        raise ValueError(f"views of {views.name}: expected {wanted} faces as {mesh.name} has, got {got}; render the views again")
    found: PartCandidates = load(BACKENDS, params.backend)(mesh, views, placed(params, weights))
    return found
