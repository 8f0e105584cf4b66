"""Pictures -> where the left hand, the right hand, what they touch and sleeves probably are, each picture by itself.

The person is taken to be on the near side, as a head-worn camera has it: who faces the camera is turned by 180 degrees first,
pictures by whoever asks. Every picture is looked at in two sizes, and each time twice, the second time in a mirror, so that a
mirrored picture has its sides swapped.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from torch import Tensor

from afford.extraction.finder import files
from afford.extraction.finder.model import HAND, SIDE, SLEEVE, TOUCHED, Hands, HandsConfig
from afford.models.weights import file_stamps
from schemas.files import FileTree

AT_ONCE = 8
"""pictures in one pass"""
GRID = 16
"""sides that the network works at are multiples of this"""
ZOOMS = (1.0, 1.5)
"""sizes at which a picture is looked at, against that of the config: small hands are found at the larger one"""
MEAN, GAMMA = 0.42, (0.5, 2.5)
"""mean level 0..1 to which every picture is brought, about that of lessons, and how far a gamma goes for it"""


def find(pictures: np.ndarray, model: Path | FileTree) -> np.ndarray:
    """(n, H, W, 3) uint8 RGB and the files of a trained finder -> (n, H, W, 4) float32 probabilities 0..1 of left hand, right
    hand, touched thing and sleeve; those of the two hands sum to at most 1.
    """
    found = np.zeros((*pictures.shape[:3], 4), np.float32)
    network = _network(model, file_stamps(model) if isinstance(model, Path) else None)
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
def _network(where: Path | FileTree, _stamp: Any) -> Hands:
    return files.read(where).eval()
