"""LaMa on disk: the published checkpoint or its TorchScript, or safetensors with either's names. No code of a file is run."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import torch
from torch import Tensor

from afford.extraction.inpaint.networks.lama_generator import GIVEN, Generator, LamaConfig
from afford.models.archive import read_tensors
from afford.models.loading import fill_weights

NEEDED = "LaMa's published checkpoint (best.ckpt), its TorchScript (big-lama.pt), or safetensors with the names of either"
INSIDE = "generator."
"""what stands before the generator's names in a checkpoint, and somewhere before them in TorchScript"""
FIRST = "model.1.ffc.convl2l.weight"


def load(name: str, device: torch.device, dtype: torch.dtype) -> Generator:
    """A model for inference, its sizes read off its tensors. ValueError, one sentence, when there is none or it does not fit."""
    path = Path(name)
    if not name or not path.is_file():
        got = f"got {name!r}, which is no file" if name else "got ''"
        raise ValueError(f"backend 'lama' needs a model: expected {NEEDED}, {got}; set hand_inpaint.lama.model")
    given = generator_tensors(read_tensors(path))
    with torch.device("meta"):
        model = Generator(config_of(given, str(path)))
    fill_weights(model, given, str(path), f"give {NEEDED}")
    return model.to(device, dtype).eval()


def generator_tensors(found: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """The generator's tensors under their own names, wherever in the file they are; losses and discriminators are left out."""
    inside = {name.partition(INSIDE)[2]: tensor for name, tensor in found.items() if _in_generator(name)}
    return inside or dict(found)


def config_of(given: Mapping[str, Tensor], where: str) -> LamaConfig:
    """Sizes as the tensors have them; ValueError when they are not those of such a generator."""
    first = given.get(FIRST)
    if first is None or first.dim() != 4 or first.shape[1] != GIVEN:
        got = "none" if first is None else str(tuple(first.shape))
        raise ValueError(f"{where}: expected the tensor {FIRST} of shape (channels, {GIVEN}, 7, 7), got {got}; give {NEEDED}")
    blocks = {name.split(".")[1] for name in given if name.endswith(".conv1.ffc.convl2l.weight")}
    halvings = sum(1 for name in given if name.endswith(".ffc.convl2l.weight") and name.split(".")[2] == "ffc") - 1
    deep = first.shape[0] * 2**halvings
    wide = next((tensor.shape[0] for name, tensor in given.items() if name.endswith(".conv1.ffc.convl2g.weight")), 0)
    return LamaConfig(int(first.shape[0]), halvings, len(blocks), wide / deep)


def _in_generator(name: str) -> bool:
    before, found, _ = name.partition(INSIDE)
    return bool(found) and before in ("", "model.")
