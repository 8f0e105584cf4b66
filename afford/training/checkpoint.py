"""The state of a training as one file: tensors and words in one safetensors file, which is there whole or not at all."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from blake3 import blake3
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

WORDS = "words"


def save(path: Path, tensors: Mapping[str, Tensor], words: Mapping[str, Any]) -> None:
    """Write tensors and JSON-able words, with a checksum of both; a kill leaves the file of before."""
    partial = path.with_name(f"{path.name}.partial")
    kept, text = {name: tensor.detach().contiguous().cpu() for name, tensor in tensors.items()}, json.dumps(words)
    save_file(kept, partial, {WORDS: json.dumps([_checksum(kept, text), text])})  # one entry: their order is not fixed
    os.replace(partial, path)


def load(path: Path) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Read what `save` wrote. ValueError for a file that is damaged, which is moved aside."""
    try:
        with safe_open(path, framework="pt") as file:
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
            check, text = json.loads(file.metadata()[WORDS])
        if check != _checksum(tensors, text):
            raise KeyError("its bytes do not fit their checksum")
        return tensors, dict(json.loads(text))
    except (SafetensorError, KeyError, TypeError, ValueError) as error:
        aside = path.replace(path.with_name(f"{path.name}.damaged"))
        raise ValueError(f"{path.name}: expected a checkpoint of a training, got a damaged file ({error}), which is now "
                         f"{aside.name}; run again to train from the beginning") from error


def _checksum(tensors: Mapping[str, Tensor], words: str) -> str:
    digest = blake3(words.encode())
    for name in sorted(tensors):
        digest.update(f"{name} {tensors[name].dtype} {tuple(tensors[name].shape)}".encode())
        digest.update(tensors[name].reshape(-1).view(torch.uint8).numpy().data)
    return digest.hexdigest()


def weights(model: nn.Module) -> dict[str, Tensor]:
    """What training changes: trainable parameters and all buffers that are kept, by name; frozen weights stay where they are."""
    frozen = {name for name, parameter in model.named_parameters() if not parameter.requires_grad}
    return {name: tensor for name, tensor in model.state_dict().items() if name not in frozen}


def restore(model: nn.Module, tensors: Mapping[str, Tensor]) -> None:
    """Put weights back. ValueError names what does not belong to the model."""
    have = weights(model)
    wrong = sorted(have.keys() ^ tensors.keys())
    if wrong:
        raise ValueError(f"checkpoint: expected the weights of this model, got others: {', '.join(wrong[:4])}")
    with torch.no_grad():
        for name, tensor in have.items():
            tensor.copy_(tensors[name])


def moments(optimiser: torch.optim.Optimizer) -> dict[str, Tensor]:
    """The state of an optimiser by '<parameter number>.<name>'."""
    state = optimiser.state_dict()["state"]
    return {f"{number}.{name}": tensor for number, kept in state.items() for name, tensor in kept.items()}


def restore_moments(optimiser: torch.optim.Optimizer, tensors: Mapping[str, Tensor]) -> None:
    """Put the state of an optimiser back."""
    state: dict[int, dict[str, Tensor]] = {}
    for name, tensor in tensors.items():
        number, _, key = name.partition(".")
        state.setdefault(int(number), {})[key] = tensor
    optimiser.load_state_dict({"state": state, "param_groups": optimiser.state_dict()["param_groups"]})
