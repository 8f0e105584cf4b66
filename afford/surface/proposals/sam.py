"""Part masks from Segment Anything, prompted with a grid of points in every view, as in AffordDex."""

from __future__ import annotations

import numpy as np

from afford.models.sam import Grid, grid_points, load_model, segment_everything
from afford.surface.proposals import Sam
from afford.surface.proposals.nms import collect_candidates, nms
from schemas.mesh import ObjectMesh, ObjectViews
from schemas.surface import PartCandidates

WEIGHTS = "a SamModel: folder of save_pretrained, or hub id as facebook/sam-vit-huge"
MET = ("authors' package, random weights, 2026-11: names and shapes of ViT-B, ViT-L, ViT-H in segment-anything 1.0; masks "
       "with tiny ones")


def propose(mesh: ObjectMesh, views: ObjectViews, params: Sam) -> PartCandidates:
    """Prompt the model in every view and suppress duplicate masks (`Propose`)."""
    model = load_model(params.model, params.device, params.dtype)
    grid = Grid(params.grid, params.least_iou, params.least_stability, params.offset, params.batch)
    points = grid_points(grid.points, *views.face.shape[1:])
    found: list[tuple[int, np.ndarray, float]] = []
    for view, (rgb, face) in enumerate(zip(views.rgb, views.face, strict=True)):
        on = face >= 0
        prompts = points[on[points[:, 1].astype(int), points[:, 0].astype(int)]]
        masks, quality = np.zeros((0, *on.shape), bool), np.zeros(0)
        if len(prompts):
            masks, quality = segment_everything(model, rgb, grid, prompts)
        masks &= on
        size = masks.sum((1, 2))
        fit = (size >= params.least_px) & (size <= params.most_share * on.sum())
        masks, quality = masks[fit], quality[fit]
        found += [(view, masks[n], float(quality[n])) for n in nms(masks, quality, params.nms_iou, params.most)]
    return collect_candidates(mesh.name, found, views.face.shape[1:])
