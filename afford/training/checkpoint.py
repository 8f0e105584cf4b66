"""The state of a training as one file: tensors and words in one safetensors file, which is there whole or not at all."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

WORDS = "words"


def save(path: Path, tensors: Mapping[str, Tensor], words: Mapping[str, Any]) -> None:
    """Write tensors and JSON-able words; a kill leaves the file of before."""
    partial = path.with_name(f"{path.name}.partial")
    save_file({name: tensor.detach().contiguous().cpu() for name, tensor in tensors.items()}, partial,
              {WORDS: json.dumps(words)})
    os.replace(partial, path)


def load(path: Path) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """What `save` wrote. ValueError for a file that is damaged."""
    try:
        with safe_open(path, framework="pt") as file:
            return {name: file.get_tensor(name) for name in file.keys()}, json.loads(file.metadata()[WORDS])  # noqa: SIM118
    except (SafetensorError, KeyError, TypeError) as error:
        raise ValueError(f"{path.name}: expected a checkpoint of a training, got a damaged file ({error}); delete it to train "
                         "from the beginning") from error


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
