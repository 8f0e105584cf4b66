"""Files of the network of held objects, and its inference on sampled frames: log odds of the object and the probability of a touch.

The files hold what was trained; the frozen encoder is read from the file of MediaPipe's palm detector.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from afford.common.files import empty_folder
from afford.extraction.hands.held_crops import HandCrop
from afford.extraction.hands.held_evidence import HeldEvidence
from afford.extraction.hands.held_model import HELD, HeldConfig, HeldNetwork, inputs
from afford.extraction.hands.palm_encoder import read_palm_encoder
from afford.extraction.landmarks.files import PALM
from afford.models.loading import CONFIG, WEIGHTS, fill_weights, read_config, write_model
from afford.models.tensor_files import read_tensors
from schemas.files import FileTree
from schemas.video import SIDES, Hand

CARD, FORMAT = "card.md", "afford-held-1"
KEPT = ("tensorboard", "previews")
HINT = "train a network with held_train"
ENCODER = "encoder."
LIMIT = 6.0
"""largest log odds of a pixel"""


def write_network(scratch: Path, model: HeldNetwork, card: str) -> Path:
    """Write the folder of a trained network, with the curves and previews of its training."""
    root = empty_folder(scratch / "out")
    write_model(root, _Trained(model), model.config, FORMAT)
    (root / CARD).write_text(card, encoding="utf-8")
    for folder in KEPT:
        if (scratch / folder).exists():
            shutil.copytree(scratch / folder, root / folder)
    return root


@dataclass(frozen=True)
class _Trained:
    """Weights without those of the frozen encoder, as 16-bit floats."""

    model: HeldNetwork

    def state_dict(self) -> dict[str, Tensor]:
        return {name: tensor.half() if tensor.is_floating_point() else tensor
                for name, tensor in self.model.state_dict().items() if not name.startswith(ENCODER)}  # fmt: skip


def read_network(where: FileTree, palm: Path) -> HeldNetwork:
    """Read a network that `write_network` wrote; `palm` is the palm detector's file. ValueError says which file does not fit."""
    config, weights = (_file(where, name) for name in (CONFIG, WEIGHTS))
    sizes = read_config(config, HeldConfig, FORMAT, str(config), HINT)
    with torch.device("meta"):
        model = HeldNetwork(sizes)
    frozen = {ENCODER + name: tensor for name, tensor in read_palm_encoder(palm).state_dict().items()}
    fill_weights(model, {**read_tensors(weights), **frozen}, str(weights), HINT)
    return model


def palm_detector(networks: FileTree | None) -> Path:
    """Path of the palm detector, whose encoder the network reads. ValueError without it."""
    found = networks.find(PALM) if networks is not None else None
    if found is None or found.path is None:
        raise ValueError("the network of held objects needs the landmark networks; run `make setup` with an internet "
                         "connection, or choose --set hand_detect.held=none")  # fmt: skip
    return found.path


def _file(where: FileTree, name: str) -> Path:
    found = where.find(name)
    if found is None or found.path is None or not found.path.is_file():
        raise ValueError(f"{where.name}: expected {name} of a trained network of held objects; {HINT}")
    return found.path


@torch.inference_mode()
def held_evidence(rgb: np.ndarray, hands: Mapping[Hand, np.ndarray], files: FileTree, palm: Path) -> HeldEvidence:
    """Segment what the hands of a picture (h, w, 3) uint8 hold; `hands` are their masks (h, w) bool by side."""
    sides = [side for side in SIDES if side in hands and hands[side].any()]
    shape = rgb.shape[:2]
    odds, touch = np.zeros(shape, np.float32), dict[Hand, float]()
    if not sides:
        return HeldEvidence(odds, touch)
    network = _cached_network(files, palm)
    crops = [HandCrop.around(hands[side], network.config.size_px) for side in sides]
    masks = np.stack([[crop.mask(hands[side]), crop.mask(_others(hands, side, shape))]
                      for crop, side in zip(crops, sides, strict=True)])  # fmt: skip
    logits, touched = network(*inputs(np.stack([crop.picture(rgb) for crop in crops]), masks))
    for n, (crop, side) in enumerate(zip(crops, sides, strict=True)):
        touch[side] = float(touched[n].sigmoid())
        held = crop.paste(np.clip(logits[n, HELD].numpy(), -LIMIT, LIMIT), shape, 0.0)
        odds = np.where(odds != 0, np.maximum(odds, held), held)
    return HeldEvidence(odds, touch)


def _others(hands: Mapping[Hand, np.ndarray], side: Hand, shape: tuple[int, ...]) -> np.ndarray:
    return np.any([np.zeros(shape, bool), *(mask for other, mask in hands.items() if other != side)], axis=0)


@lru_cache(maxsize=1)
def _cached_network(files: FileTree, palm: Path) -> HeldNetwork:
    return read_network(files, palm).eval().to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # as in init_model
