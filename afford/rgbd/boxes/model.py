"""Encoder, boxes, and a mask of affordances inside each box."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate, softplus

from afford.rgbd.boxes.align import pasted, roi_align
from afford.rgbd.model import files
from afford.rgbd.model.config import Sor3dConfig
from afford.rgbd.model.encoder import Encoder
from afford.rgbd.model.inputs import Frames
from afford.rgbd.model.parts import chain, convolution, xavier
from schemas.interaction import BACKGROUND

FORMAT = "afford-boxes-1"
ALIGNED = 14
"""side of the features of a box; masks have twice as many"""
MOST, OVERLAP, LEAST = 5, 0.5, 0.5
"""proposals of a picture at most; IoU above which the less likely one of two is dropped; chance below which all but the best are"""


class Seen(NamedTuple):
    """What is known of n pictures before masks."""

    features: Tensor
    """(n, c, h, w) at a quarter of the picture"""
    thing: Tensor
    """(n, h, w) logits: a cell lies in the middle of a thing"""
    box: Tensor
    """(n, 4, h, w) the box that each cell proposes"""


class Boxes(nn.Module):
    """Single pictures: the last frame of what it is given. The config's depth, widths, norm and size count."""

    def __init__(self, config: Sor3dConfig) -> None:
        super().__init__()
        self.config = config
        *_, quarter, eighth = config.widths
        self.encoder = Encoder(4 if config.depth else 3, config.widths, config.norm)
        self.lateral, self.top = nn.Conv2d(quarter, eighth, 1), nn.Conv2d(eighth, eighth, 1)
        self.box = nn.Sequential(chain([eighth] * 3, config.norm), nn.Conv2d(eighth, 5, 1))
        self.inside = chain([eighth] * 4, config.norm)
        self.masks = nn.Sequential(convolution(eighth, eighth, config.norm), nn.Conv2d(eighth, config.labels, 1))

    def forward(self, frames: Frames) -> Seen:
        """n sequences, of which the last frame is looked at."""
        appearance = frames.appearance[:, -1] if self.config.depth else frames.appearance[:, -1, :3]
        *_, quarter, eighth = self.encoder(appearance)
        size = (quarter.shape[-2], quarter.shape[-1])
        features = self.lateral(quarter) + interpolate(self.top(eighth), size, mode="nearest")
        found = self.box(features)
        return Seen(features, found[:, 0], _boxes(softplus(found[:, 1:])))

    def affordances(self, features: Tensor, boxes: Tensor) -> Tensor:
        """Logits (n, 10, 28, 28) inside a box of each picture."""
        found: Tensor = self.masks(interpolate(self.inside(roi_align(features, boxes, ALIGNED)), scale_factor=2.0, mode="nearest"))
        return found


def _boxes(reach: Tensor) -> Tensor:
    """How far a box reaches to the left, top, right and bottom of each cell's centre -> the box."""
    height, width = reach.shape[-2:]
    y = ((torch.arange(height, device=reach.device) + 0.5) / height)[:, None].expand(height, width)
    x = ((torch.arange(width, device=reach.device) + 0.5) / width).expand(height, width)
    return torch.stack([x - reach[:, 0], y - reach[:, 1], x + reach[:, 2], y + reach[:, 3]], 1)


def proposals(seen: Seen, picture: int) -> Tensor:
    """Boxes (k, 4) of one picture, k >= 1, the likeliest first; none overlaps a likelier one much."""
    chance, boxes = seen.thing[picture].flatten().sigmoid(), seen.box[picture].flatten(1).T
    kept: list[Tensor] = []
    for n in chance.argsort(descending=True, stable=True).tolist():
        if kept and (len(kept) == MOST or chance[n] < LEAST):
            break
        if all(float(overlap(boxes[n], other)) <= OVERLAP for other in kept):
            kept.append(boxes[n])
    return torch.stack(kept)


def overlap(a: Tensor, b: Tensor) -> Tensor:
    """Intersection over union of boxes (..., 4)."""
    both = (torch.minimum(a[..., 2:], b[..., 2:]) - torch.maximum(a[..., :2], b[..., :2])).clamp(min=0).prod(-1)
    return both / ((a[..., 2:] - a[..., :2]).prod(-1) + (b[..., 2:] - b[..., :2]).prod(-1) - both).clamp(min=1e-9)


def painted(model: Boxes, features: Tensor, boxes: Tensor, size: tuple[int, int]) -> Tensor:
    """Probability (10, h, w) on a picture with features (1, c, h', w') of what is inside boxes (k, 4), the likeliest first and on
    top; outside of all is background.
    """
    inside = model.affordances(features.expand(len(boxes), -1, -1, -1), boxes).softmax(1)
    maps, where = pasted(inside, boxes, *size)
    whole = torch.zeros_like(maps[0])
    whole[BACKGROUND] = 1
    for plane, mask in zip(reversed(maps), reversed(where), strict=True):
        whole = torch.where(mask, plane, whole)
    return whole


def build(config: Sor3dConfig, seed: int) -> Boxes:
    """A new model with Xavier's weights from `seed` alone."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        model = Boxes(config)
        xavier(model)
    return model


def load(folder: Path) -> Boxes:
    """The model that a training saved, in evaluation mode. ValueError when it is another, or damaged."""
    model = build(files.read_config(folder, FORMAT), 0)
    files.fill(model, folder)
    return model.eval()
