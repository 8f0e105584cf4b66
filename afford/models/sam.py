"""Everything that Segment Anything (Kirillov et al. 2023) sees in a picture: a grid of points, three masks for each.

Through `transformers.SamModel`; the class's own processor needs a package that does not work beside the pinned torch, so that
pictures are scaled and normalised here, with the published preprocessing (ImageNet's mean and deviation).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import interpolate, pad
from transformers import SamModel

from afford.models.loading import pretrained
from afford.models.normalise import normalised


@dataclass(frozen=True)
class Grid:
    """How densely it is asked, and what counts as a mask. Defaults: AffordDex's paper; its code has 32 points a side."""

    points: int = 16
    """points along each side"""
    least_iou: float = 0.88
    """IoU that the model predicts for a mask"""
    least_stability: float = 0.7
    """IoU of the mask cut `offset` above and below its threshold"""
    offset: float = 0.7
    at_once: int = 64
    """points in one pass"""


def load_model(name: str, device: str = "cpu", dtype: str = "float32") -> SamModel:
    """A model from a local folder, for inference; ValueError in one sentence when it is not there or is another one."""
    model: SamModel = pretrained(SamModel, name, "sam", device, dtype)
    return model


def grid_points(count: int, height: int, width: int) -> np.ndarray:
    """(count ** 2, 2) float32 x and y in px: i * side / (count + 1), i = 1..count, row by row."""
    x, y = (np.arange(1, count + 1) * side / (count + 1) for side in (width, height))
    return np.stack(np.meshgrid(x, y), -1).reshape(-1, 2).astype(np.float32)


@torch.inference_mode()
def everything(model: SamModel, rgb: np.ndarray, grid: Grid, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(m, h, w) bool masks of a picture (h, w, 3) uint8 and the IoU (m,) that the model predicts for each; those that are neither
    sure nor stable are left out. `points` (n, 2) px are asked.
    """
    height, width = rgb.shape[:2]
    side = int(model.config.vision_config.image_size)
    scale = side / max(height, width)
    inner = round(height * scale), round(width * scale)
    image = torch.from_numpy(rgb.copy()).permute(2, 0, 1)[None].float().to(model.device) / 255
    small = normalised(interpolate(image, inner, mode="bilinear", align_corners=False, antialias=True))
    embedding = model.get_image_embeddings(pad(small, (0, side - inner[1], 0, side - inner[0])).to(model.dtype))
    kept: list[tuple[np.ndarray, np.ndarray]] = []
    for at in range(0, len(points), grid.at_once):
        asked = torch.from_numpy(points[at : at + grid.at_once] * np.float32(scale))[None, :, None].to(model.device)
        found = model(image_embeddings=embedding, input_points=asked, multimask_output=True)
        logits, iou = found.pred_masks[0].flatten(0, 1).float(), found.iou_scores[0].flatten().float()
        kept.append(_sure(logits, iou, grid, (side, inner, (height, width))))
    return np.concatenate([masks for masks, _ in kept]), np.concatenate([iou for _, iou in kept])


def _sure(logits: Tensor, iou: Tensor, grid: Grid,
          sizes: tuple[int, tuple[int, int], tuple[int, int]]) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Masks at the size of the picture that pass both thresholds."""
    side, inner, full = sizes
    chosen = (iou >= grid.least_iou) & (stability(logits, grid.offset) >= grid.least_stability)
    large = interpolate(logits[chosen][:, None], (side, side), mode="bilinear", align_corners=False)[..., : inner[0], : inner[1]]
    masks = interpolate(large, full, mode="bilinear", align_corners=False)[:, 0] > 0
    return masks.cpu().numpy(), iou[chosen].float().cpu().numpy()


def stability(logits: Tensor, offset: float) -> Tensor:
    """(m,) IoU of masks (m, h, w) cut at `offset` and at -`offset`; 0 for what is empty at both."""
    tight, loose = ((logits > cut).flatten(1).sum(1).float() for cut in (offset, -offset))
    return tight / loose.clamp(min=1)
