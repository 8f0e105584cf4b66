"""Hand finder: a small network trained on rendered rooms, its files, and inference on pictures.

The person is expected on the near side, as for a head-worn camera; the caller rotates pictures of a person who faces the camera by
180 degrees. Every picture is processed at two sizes, each with its mirror image, so that mirroring a picture swaps the sides.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate, relu

from afford.common.files import empty_folder
from afford.models.loading import CONFIG, WEIGHTS, fill_from_file, read_config, write_model
from afford.models.weights import file_stamps
from schemas.files import FileTree

HAND, SIDE, TOUCHED, SLEEVE = range(4)
"""channels of the logits: hand; right hand rather than left, where there is a hand; touched object; sleeve"""


@dataclass(frozen=True)
class HandFinderConfig:
    """Sizes of the hand finder."""

    height_px: int = 144
    """approximate height of the input; the aspect ratio of a picture is kept"""
    width_px: int = 256
    """approximate width of the input"""
    widths: tuple[int, ...] = (16, 24, 48, 80, 128)
    """channels after each downsampling"""


class HandFinder(nn.Module):
    """U-Net with global context: pictures (b, 3, h, w), RGB 0..1, of any size -> logits (b, 4, h, w)."""

    def __init__(self, config: HandFinderConfig) -> None:
        super().__init__()
        self.config = config
        first, *rest = config.widths
        self.stem = nn.Sequential(_layer(5, first, 2), _layer(first, first))
        self.down = nn.ModuleList(nn.Sequential(_layer(a, b, 2), _Residual(b)) for a, b in zip(config.widths, rest, strict=False))
        self.whole = nn.Linear(config.widths[-1], config.widths[-1])
        self.up = nn.ModuleList(_layer(a + b, b) for a, b in zip(rest[::-1], config.widths[-2::-1], strict=True))
        self.head = nn.Conv2d(first, 4, 1)

    def forward(self, pictures: Tensor) -> Tensor:
        """Compute logits at half the size, and resize them to that of the pictures."""
        seen = [self.stem(torch.cat([pictures * 4 - 2, _coordinates(pictures)], 1))]
        for down in self.down:
            seen.append(down(seen[-1]))
        x = seen[-1] + relu(self.whole(seen[-1].mean((2, 3))))[..., None, None]
        for up, skip in zip(self.up, seen[-2::-1], strict=True):
            x = up(torch.cat([_resize(x, skip.shape), skip], 1))
        return _resize(self.head(x), pictures.shape)


class _Residual(nn.Module):
    def __init__(self, width: int) -> None:
        super().__init__()
        self.change = nn.Sequential(_layer(width, width), nn.Conv2d(width, width, 3, padding=1, bias=False), nn.BatchNorm2d(width))

    def forward(self, x: Tensor) -> Tensor:
        return relu(x + self.change(x))


def _coordinates(pictures: Tensor) -> Tensor:
    """Coordinate channels (b, 2, h, w): x and y of every pixel, -1..1."""
    down, across = (torch.linspace(-1, 1, side, device=pictures.device) for side in pictures.shape[-2:])
    place = torch.stack([across.expand(len(down), -1), down[:, None].expand(-1, len(across))])
    return place.expand(len(pictures), -1, -1, -1)


def _layer(before: int, after: int, stride: int = 1) -> nn.Sequential:
    """Build a convolution with batch normalisation and ReLU."""
    return nn.Sequential(nn.Conv2d(before, after, 3, stride, 1, bias=False), nn.BatchNorm2d(after), nn.ReLU())


def _resize(x: Tensor, shape: torch.Size) -> Tensor:
    return interpolate(x, (shape[-2], shape[-1]), mode="bilinear", align_corners=False)


CARD, FORMAT = "card.md", "afford-hands-2"
KEPT = ("tensorboard", "previews")


def write_network(scratch: Path, model: HandFinder, card: str) -> Path:
    """Write the folder of a trained hand finder, with the curves and previews of its training."""
    root = empty_folder(scratch / "out")
    write_model(root, model, model.config, FORMAT)
    (root / CARD).write_text(card, encoding="utf-8")
    for folder in KEPT:
        if (scratch / folder).exists():
            shutil.copytree(scratch / folder, root / folder)
    return root


def read_network(where: Path | FileTree) -> HandFinder:
    """The network that `write` wrote, out of a folder or a store; ValueError says which file does not fit."""
    config, weights = (_file(where, name) for name in (CONFIG, WEIGHTS))
    sizes = read_config(config, HandFinderConfig, FORMAT, str(config), "train a finder with hands_train")
    with torch.device("meta"):
        model = HandFinder(sizes)
    return fill_from_file(model, weights, str(weights))


def _file(where: Path | FileTree, name: str) -> Path:
    if isinstance(where, Path):
        found = where / name
    else:
        listed = where.find(name)
        found = listed.path if listed else Path(where.name) / name
    if not found.is_file():
        raise ValueError(f"{found.parent}: expected {name} of a trained finder of hands; train one with hands_train")
    return found


BATCH = 8
"""pictures in one pass"""
GRID = 16
"""height and width of the input are multiples of this"""
ZOOMS = (1.0, 1.5)
"""scales of the input relative to the size in the config; the larger one finds small hands"""
MEAN, GAMMA = 0.42, (0.5, 2.5)
"""mean level 0..1 to which pictures are normalised, about that of the training data, and limits of the gamma for it"""


def segment(pictures: np.ndarray, model: Path | FileTree) -> np.ndarray:
    """Compute probabilities (n, H, W, 4) float32 of left hand, right hand, touched object and sleeve.

    pictures: (n, H, W, 3) uint8. `model` are the files of a trained hand finder. Probabilities of both hands sum to at most 1.
    """
    found = np.zeros((*pictures.shape[:3], 4), np.float32)
    network = _cached_network(model, file_stamps(model) if isinstance(model, Path) else None)
    for zoom in ZOOMS:
        for at, small in _batches(pictures, input_size(pictures.shape[1], pictures.shape[2], network.config, zoom)):
            for n, answer in enumerate(predict(network, small).permute(0, 2, 3, 1).numpy(), at):
                found[n] += cv2.resize(answer, pictures.shape[2:0:-1], interpolation=cv2.INTER_LINEAR) / len(ZOOMS)
    return found


@torch.inference_mode()
def predict(network: HandFinder, pictures: Tensor) -> Tensor:
    """Predict probabilities (b, 4, h, w) of small pictures (b, 3, h, w), averaged with those of the mirror images."""
    plain, mirrored = network(pictures), network(pictures.flip(3)).flip(3)
    mirrored[:, SIDE] *= -1
    probability = ((plain + mirrored) / 2).sigmoid()
    hand, right = probability[:, HAND], probability[:, SIDE]
    return torch.stack([hand * (1 - right), hand * right, probability[:, TOUCHED], probability[:, SLEEVE]], 1)


def input_size(height: int, width: int, config: HandFinderConfig, zoom: float = 1.0) -> tuple[int, int]:
    """Height and width of the network input: the area of the config at the aspect ratio of the picture, scaled by `zoom`."""
    scale = zoom * (config.height_px * config.width_px / (height * width)) ** 0.5
    down, across = (max(GRID, GRID * round(scale * side / GRID)) for side in (height, width))
    return down, across


def _batches(pictures: np.ndarray, size_hw: tuple[int, int]) -> Iterator[tuple[int, Tensor]]:
    down, across = size_hw
    for at in range(0, len(pictures), BATCH):
        small = [cv2.resize(picture, (across, down), interpolation=cv2.INTER_AREA) for picture in pictures[at : at + BATCH]]
        yield at, torch.from_numpy(np.stack([normalise_exposure(picture) for picture in small])).permute(0, 3, 1, 2)


def normalise_exposure(picture: np.ndarray) -> np.ndarray:
    """Normalise the exposure of a picture (h, w, 3) uint8 by a gamma that brings its mean level near MEAN; float32, 0..1."""
    gamma = np.log(MEAN) / np.log(np.clip(picture.mean() / 255, 0.02, 0.98))
    return (picture.astype(np.float32) / 255) ** np.float32(np.clip(gamma, *GAMMA))


@lru_cache(maxsize=1)
def _cached_network(where: Path | FileTree, _stamp: Any) -> HandFinder:
    return read_network(where).eval()


def find(rgb: np.ndarray, params: None, weights: FileTree | None = None) -> np.ndarray:
    """Find hands with the hand finder, see `Find`; `weights` are the files that `hands_train` wrote."""
    if weights is None:
        raise ValueError("backend 'network' needs the files that hands_train wrote; pass them as `weights`")
    return segment(rgb, weights)
