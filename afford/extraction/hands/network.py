"""The embedded finder: a small network that learned hands in rooms that are rendered here."""

from __future__ import annotations

import dataclasses
import json
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from safetensors.torch import save_file
from torch import Tensor, nn
from torch.nn.functional import interpolate, relu

from afford.models.loading import fill_from_file, read_config
from afford.models.weights import file_stamps
from schemas.files import FileTree

HAND, SIDE, TOUCHED, SLEEVE = range(4)
"""planes of the logits: a hand or not; the right hand rather than the left one, where there is a hand; a thing that is touched;
cloth on an arm"""


@dataclass(frozen=True)
class HandsConfig:
    """Sizes."""

    height_px: int = 144
    """height to which a picture is brought, about: its aspect stays"""
    width_px: int = 256
    """width of that"""
    widths: tuple[int, ...] = (16, 24, 48, 80, 128)
    """channels after each halving of the picture"""


class Hands(nn.Module):
    """Pictures (b, 3, h, w), RGB 0..1, of any size -> logits (b, 4, h, w)."""

    def __init__(self, config: HandsConfig) -> None:
        super().__init__()
        self.config = config
        first, *rest = config.widths
        self.stem = nn.Sequential(_layer(5, first, 2), _layer(first, first))
        self.down = nn.ModuleList(nn.Sequential(_layer(a, b, 2), _Residual(b)) for a, b in zip(config.widths, rest, strict=False))
        self.whole = nn.Linear(config.widths[-1], config.widths[-1])
        self.up = nn.ModuleList(_layer(a + b, b) for a, b in zip(rest[::-1], config.widths[-2::-1], strict=True))
        self.head = nn.Conv2d(first, 4, 1)

    def forward(self, pictures: Tensor) -> Tensor:
        """The last features are at half the size; their logits are brought to that of the pictures."""
        seen = [self.stem(torch.cat([pictures * 4 - 2, _places(pictures)], 1))]
        for down in self.down:
            seen.append(down(seen[-1]))
        x = seen[-1] + relu(self.whole(seen[-1].mean((2, 3))))[..., None, None]
        for up, skip in zip(self.up, seen[-2::-1], strict=True):
            x = up(torch.cat([_resized(x, skip.shape), skip], 1))
        return _resized(self.head(x), pictures.shape)


class _Residual(nn.Module):
    def __init__(self, width: int) -> None:
        super().__init__()
        self.change = nn.Sequential(_layer(width, width), nn.Conv2d(width, width, 3, padding=1, bias=False), nn.BatchNorm2d(width))

    def forward(self, x: Tensor) -> Tensor:
        return relu(x + self.change(x))


def _places(pictures: Tensor) -> Tensor:
    """(b, 2, h, w): how far every pixel is to the right and down, -1..1."""
    down, across = (torch.linspace(-1, 1, side, device=pictures.device) for side in pictures.shape[-2:])
    place = torch.stack([across.expand(len(down), -1), down[:, None].expand(-1, len(across))])
    return place.expand(len(pictures), -1, -1, -1)


def _layer(before: int, after: int, stride: int = 1) -> nn.Sequential:
    """A convolution, its norm and what makes it bend."""
    return nn.Sequential(nn.Conv2d(before, after, 3, stride, 1, bias=False), nn.BatchNorm2d(after), nn.ReLU())


def _resized(x: Tensor, shape: torch.Size) -> Tensor:
    return interpolate(x, (shape[-2], shape[-1]), mode="bilinear", align_corners=False)


CONFIG, WEIGHTS, CARD, FORMAT = "config.json", "model.safetensors", "card.md", "afford-hands-2"
KEPT = ("tensorboard", "previews")


def write_network(scratch: Path, model: Hands, card: str) -> Path:
    """The folder of files; what a training left of curves and pictures comes along."""
    root = scratch / "out"
    shutil.rmtree(root, ignore_errors=True)
    root.mkdir(parents=True)
    described = {"format": FORMAT, **dataclasses.asdict(model.config)}
    (root / CONFIG).write_text(json.dumps(described, indent=2, sort_keys=True) + "\n", encoding="utf-8")
    save_file({name: tensor.detach().cpu().contiguous() for name, tensor in model.state_dict().items()}, root / WEIGHTS)
    (root / CARD).write_text(card, encoding="utf-8")
    for folder in KEPT:
        if (scratch / folder).exists():
            shutil.copytree(scratch / folder, root / folder)
    return root


def read_network(where: Path | FileTree) -> Hands:
    """The network that `write` wrote, out of a folder or a store; ValueError says which file does not fit."""
    config, weights = (_file(where, name) for name in (CONFIG, WEIGHTS))
    sizes = read_config(config, HandsConfig, FORMAT, str(config), "train a finder with hands_train")
    with torch.device("meta"):
        model = Hands(sizes)
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


AT_ONCE = 8
"""pictures in one pass"""
GRID = 16
"""sides that the network works at are multiples of this"""
ZOOMS = (1.0, 1.5)
"""sizes at which a picture is looked at, against that of the config: small hands are found at the larger one"""
MEAN, GAMMA = 0.42, (0.5, 2.5)
"""mean level 0..1 to which every picture is brought, about that of lessons, and how far a gamma goes for it"""


def segment(pictures: np.ndarray, model: Path | FileTree) -> np.ndarray:
    """(n, H, W, 3) uint8 RGB and the files of a trained finder -> (n, H, W, 4) float32 probabilities 0..1 of left hand, right
    hand, touched thing and sleeve; those of the two hands sum to at most 1.
    """
    found = np.zeros((*pictures.shape[:3], 4), np.float32)
    network = _cached(model, file_stamps(model) if isinstance(model, Path) else None)
    for zoom in ZOOMS:
        for at, small in _batches(pictures, size(pictures.shape[1], pictures.shape[2], network.config, zoom)):
            for n, answer in enumerate(said(network, small).permute(0, 2, 3, 1).numpy(), at):
                found[n] += cv2.resize(answer, pictures.shape[2:0:-1], interpolation=cv2.INTER_LINEAR) / len(ZOOMS)
    return found


@torch.inference_mode()
def said(network: Hands, pictures: Tensor) -> Tensor:
    """(b, 4, h, w) of small pictures (b, 3, h, w): as they are, and in a mirror."""
    plain, mirrored = network(pictures), network(pictures.flip(3)).flip(3)
    mirrored[:, SIDE] *= -1
    chance = ((plain + mirrored) / 2).sigmoid()
    hand, right = chance[:, HAND], chance[:, SIDE]
    return torch.stack([hand * (1 - right), hand * right, chance[:, TOUCHED], chance[:, SLEEVE]], 1)


def size(height: int, width: int, config: HandsConfig, zoom: float = 1.0) -> tuple[int, int]:
    """Height and width at which the network looks at a picture: as many pixels as its config says, at its own aspect; `zoom` times
    as high and as wide.
    """
    scale = zoom * (config.height_px * config.width_px / (height * width)) ** 0.5
    down, across = (max(GRID, GRID * round(scale * side / GRID)) for side in (height, width))
    return down, across


def _batches(pictures: np.ndarray, size_hw: tuple[int, int]) -> Iterator[tuple[int, Tensor]]:
    down, across = size_hw
    for at in range(0, len(pictures), AT_ONCE):
        small = [cv2.resize(picture, (across, down), interpolation=cv2.INTER_AREA) for picture in pictures[at : at + AT_ONCE]]
        yield at, torch.from_numpy(np.stack([exposed(picture) for picture in small])).permute(0, 3, 1, 2)


def exposed(picture: np.ndarray) -> np.ndarray:
    """A picture (h, w, 3) uint8 as float32 0..1, with a gamma that brings its mean level near MEAN, as far as it goes."""
    gamma = np.log(MEAN) / np.log(np.clip(picture.mean() / 255, 0.02, 0.98))
    return (picture.astype(np.float32) / 255) ** np.float32(np.clip(gamma, *GAMMA))


@lru_cache(maxsize=1)
def _cached(where: Path | FileTree, _stamp: Any) -> Hands:
    return read_network(where).eval()


def find(rgb: np.ndarray, params: None, weights: FileTree | None = None) -> np.ndarray:
    """`weights`: what hands_train wrote."""
    if weights is None:
        raise ValueError("backend 'network': expected the files that hands_train wrote, got none; give them as `weights`")
    return segment(rgb, weights)
