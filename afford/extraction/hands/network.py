"""Files of the hand finder, and its inference on pictures.

The person is expected on the near side, as for a head-worn camera; the caller rotates pictures of a person who faces the camera by
180 degrees.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from torch import Tensor

from afford.common.files import empty_folder
from afford.extraction.hands.model import HAND, PALM, PLAIN, SIDE, SLEEVE, TOUCHED, HandFinder, HandFinderConfig
from afford.models.loading import CONFIG, WEIGHTS, fill_from_file, read_config, write_model
from afford.models.weights import file_stamps
from schemas.files import FileTree

CARD, CALIBRATION = "card.md", "calibration.json"
FORMATS = {PLAIN: "afford-hands-3", PALM: "afford-hands-3-palm"}
"""format of the config by encoder"""
KEPT = ("tensorboard", "previews")
HINT = "train a finder with hands_train"


@dataclass(frozen=True)
class Calibration:
    """Line from the log odds of the network to those of a hand, fitted on materials that the training lacks."""

    scale: float = 1.0
    bias: float = 0.0


def write_network(scratch: Path, model: HandFinder, card: str, calibration: Calibration = Calibration()) -> Path:
    """Write the folder of a trained hand finder, with the curves and previews of its training."""
    root = empty_folder(scratch / "out")
    write_model(root, model, model.config, FORMATS[model.kind])
    (root / CALIBRATION).write_text(json.dumps(asdict(calibration), indent=2) + "\n", encoding="utf-8")
    (root / CARD).write_text(card, encoding="utf-8")
    for folder in KEPT:
        if (scratch / folder).exists():
            shutil.copytree(scratch / folder, root / folder)
    return root


def read_network(where: Path | FileTree) -> HandFinder:
    """The network that `write_network` wrote, out of a folder or a store; ValueError says which file does not fit."""
    config, weights = (_file(where, name) for name in (CONFIG, WEIGHTS))
    kind = PALM if f'"{FORMATS[PALM]}"' in config.read_text(encoding="utf-8", errors="replace") else PLAIN
    sizes = read_config(config, HandFinderConfig, FORMATS[kind], str(config), HINT)
    with torch.device("meta"):
        model = HandFinder(sizes, kind)
    return fill_from_file(model, weights, str(weights))


def read_calibration(where: Path | FileTree) -> Calibration:
    """Calibration of a trained finder. ValueError for a file that is not one."""
    path = _file(where, CALIBRATION)
    try:
        found = Calibration(**json.loads(path.read_text(encoding="utf-8")))
        sound = 0 < float(found.scale) < 100 and abs(float(found.bias)) < 100
    except (ValueError, TypeError, RecursionError) as error:
        raise ValueError(f"{path}: expected the numbers scale and bias of a calibration; {HINT}") from error
    if not sound:
        raise ValueError(f"{path}: expected scale in 0..100 and bias in -100..100, got {found.scale} and {found.bias}; {HINT}")
    return found


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
MEAN, GAMMA = 0.42, (0.5, 2.5)
"""mean level 0..1 to which pictures are normalised, about that of the training data, and limits of the gamma for it"""


def segment(pictures: np.ndarray, model: Path | FileTree, zoom: float = 1.0) -> np.ndarray:
    """Compute calibrated probabilities (n, H, W, 4) float32 of left hand, right hand, touched object and sleeve.

    pictures: (n, H, W, 3) uint8. `model` are the files of a trained hand finder. zoom: size of the input relative to that in the
    config. Probabilities of both hands sum to at most 1.
    """
    found = np.zeros((*pictures.shape[:3], 4), np.float32)
    network, calibration = _cached_network(model, file_stamps(model) if isinstance(model, Path) else None)
    for at, small in _batches(pictures, input_size(pictures.shape[1], pictures.shape[2], network.config, zoom)):
        for n, answer in enumerate(predict(network, small, calibration).permute(0, 2, 3, 1).numpy(), at):
            found[n] = cv2.resize(answer, pictures.shape[2:0:-1], interpolation=cv2.INTER_LINEAR)
    return found


@torch.inference_mode()
def predict(network: HandFinder, pictures: Tensor, calibration: Calibration = Calibration()) -> Tensor:
    """Predict probabilities (b, 4, h, w) of small pictures (b, 3, h, w), RGB 0..1."""
    logits = network(pictures)
    logits[:, HAND] = logits[:, HAND] * calibration.scale + calibration.bias
    probability = logits.sigmoid()
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
def _cached_network(where: Path | FileTree, _stamp: Any) -> tuple[HandFinder, Calibration]:
    model = read_network(where).eval().to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # as in init_model
    return model, read_calibration(where)


def find(rgb: np.ndarray, params: None, weights: FileTree | None = None) -> np.ndarray:
    """Find hands with the hand finder, see `Find`; `weights` are the files that `hands_train` wrote."""
    if weights is None:
        raise ValueError("finder 'network' needs the files that hands_train wrote; pass them as `weights`")
    return segment(rgb, weights)
