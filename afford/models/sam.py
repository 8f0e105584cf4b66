"""Segment Anything (Kirillov et al. 2023) prompted with a grid of points, with three masks for each point.

The model is `transformers.SamModel`. Its own processor needs a package that does not work beside the pinned torch, so pictures are
scaled and normalised here, with the published preprocessing (mean and deviation of ImageNet).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import interpolate, pad
from transformers import SamModel

from afford.models.loading import load_pretrained
from afford.models.normalise import normalised


@dataclass(frozen=True)
class Grid:
    """Density of the grid, and thresholds of masks; defaults of AffordDex's paper, whose code has 32 points a side."""

    points: int = 16
    """points along each side"""
    least_iou: float = 0.88
    """least IoU that the model predicts for a mask"""
    least_stability: float = 0.7
    """least IoU of the mask cut `offset` above and below its threshold"""
    offset: float = 0.7
    at_once: int = 64
    """points in one pass"""


def load_model(name: str, device: str = "cpu", dtype: str = "float32") -> SamModel:
    """Load a model from a local folder, for inference. ValueError, one sentence, for no model or another kind of model."""
    model: SamModel = load_pretrained(SamModel, name, "sam", device, dtype)
    return model


def grid_points(count: int, height: int, width: int) -> np.ndarray:
    """Grid points (count ** 2, 2) float32 x, y in px: i * side / (count + 1), i = 1..count, row by row."""
    x, y = (np.arange(1, count + 1) * side / (count + 1) for side in (width, height))
    return np.stack(np.meshgrid(x, y), -1).reshape(-1, 2).astype(np.float32)


@torch.inference_mode()
def segment_everything(model: SamModel, rgb: np.ndarray, grid: Grid, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Masks (m, h, w) bool of a picture (h, w, 3) uint8, prompted with `points` (n, 2) px, and their predicted IoU (m,).

    Masks of low predicted IoU or low stability are left out.
    """
    height, width = rgb.shape[:2]
    side = int(model.config.vision_config.image_size)
    scale = side / max(height, width)
    inner = round(height * scale), round(width * scale)
    image = torch.from_numpy(rgb.copy()).permute(2, 0, 1)[None].float().to(model.device) / 255
    small = normalised(interpolate(image, inner, mode="bilinear", align_corners=False, antialias=True))
    embedding = model.get_image_embeddings(pad(small, (0, side - inner[1], 0, side - inner[0])).to(model.dtype))
    masks: list[tuple[np.ndarray, np.ndarray]] = []
    for at in range(0, len(points), grid.at_once):
        prompt = torch.from_numpy(points[at : at + grid.at_once] * np.float32(scale))[None, :, None].to(model.device)
        found = model(image_embeddings=embedding, input_points=prompt, multimask_output=True)
        logits, iou = found.pred_masks[0].flatten(0, 1).float(), found.iou_scores[0].flatten().float()
        masks.append(_sure(logits, iou, grid, (side, inner, (height, width))))
    return np.concatenate([one for one, _ in masks]), np.concatenate([iou for _, iou in masks])


def _sure(logits: Tensor, iou: Tensor, grid: Grid,
          sizes: tuple[int, tuple[int, int], tuple[int, int]]) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Masks that pass both thresholds, at the size of the picture."""
    side, inner, full = sizes
    chosen = (iou >= grid.least_iou) & (stability(logits, grid.offset) >= grid.least_stability)
    large = interpolate(logits[chosen][:, None], (side, side), mode="bilinear", align_corners=False)[..., : inner[0], : inner[1]]
    masks = interpolate(large, full, mode="bilinear", align_corners=False)[:, 0] > 0
    return masks.cpu().numpy(), iou[chosen].float().cpu().numpy()


def stability(logits: Tensor, offset: float) -> Tensor:
    """IoU (m,) of masks (m, h, w) cut at `offset` and at -`offset`; 0 for a mask that is empty at both."""
    tight, loose = ((logits > cut).flatten(1).sum(1).float() for cut in (offset, -offset))
    return tight / loose.clamp(min=1)
