"""What is inside a box, on a grid of its own, and back. Boxes are left, top, right, bottom as shares of the picture's sides."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d, grid_sample

SAMPLES = 2
"""of a bin, each way"""


def roi_align(features: Tensor, boxes: Tensor, size: int) -> Tensor:
    """(n, c, h, w) and a box of each (n, 4) -> (n, c, size, size): means of bilinear samples (He et al. 2017, RoIAlign)."""
    steps = (torch.arange(size * SAMPLES, device=boxes.device) + 0.5) / (size * SAMPLES)
    x, y = (boxes[:, k, None] + (boxes[:, k + 2, None] - boxes[:, k, None]) * steps for k in (0, 1))
    grid = torch.stack(torch.broadcast_tensors(x[:, None, :], y[:, :, None]), -1)
    sampled = grid_sample(features, 2 * grid - 1, mode="bilinear", padding_mode="border", align_corners=False)
    return avg_pool2d(sampled, SAMPLES)


def labels_inside(label: Tensor, boxes: Tensor, size: int) -> Tensor:
    """(n, h, w) whole numbers -> (n, size, size): the nearest pixel of each bin's centre."""
    steps = (torch.arange(size, device=boxes.device) + 0.5) / size
    x, y = (boxes[:, k, None] + (boxes[:, k + 2, None] - boxes[:, k, None]) * steps for k in (0, 1))
    column = (x * label.shape[2]).long().clamp(0, label.shape[2] - 1)
    row = (y * label.shape[1]).long().clamp(0, label.shape[1] - 1)
    return label[torch.arange(len(label), device=label.device)[:, None, None], row[:, :, None], column[:, None, :]]


def pasted(maps: Tensor, boxes: Tensor, height: int, width: int) -> tuple[Tensor, Tensor]:
    """(n, c, s, s) inside boxes (n, 4) -> the same on the picture (n, c, height, width), and what lies inside."""
    x = ((torch.arange(width, device=boxes.device) + 0.5) / width - boxes[:, :1]) / (boxes[:, 2:3] - boxes[:, :1])
    y = ((torch.arange(height, device=boxes.device) + 0.5) / height - boxes[:, 1:2]) / (boxes[:, 3:] - boxes[:, 1:2])
    grid = torch.stack(torch.broadcast_tensors(x[:, None, :], y[:, :, None]), -1)
    inside = ((grid > 0) & (grid < 1)).all(-1)
    return grid_sample(maps, 2 * grid - 1, mode="bilinear", padding_mode="border", align_corners=False), inside
