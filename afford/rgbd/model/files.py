"""A model as a folder: config.json, model.safetensors. Nothing is ever unpickled, and nothing is loaded that does not fit."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from afford.rgbd.model.config import Sor3dConfig
from afford.rgbd.model.model import Sor3d, build

CONFIG, WEIGHTS, FORMAT = "config.json", "model.safetensors", "afford-sor3d-1"


class Configured(Protocol):
    """A model that knows its config."""

    config: Sor3dConfig

    def state_dict(self) -> Mapping[str, Tensor]:
        """Its weights by name."""


def save(model: Configured, folder: Path, form: str = FORMAT) -> None:
    """Write a model; the same weights give the same bytes. `form` tells the kind of model."""
    folder.mkdir(parents=True, exist_ok=True)
    described = {"format": form, **dataclasses.asdict(model.config)}
    (folder / CONFIG).write_text(json.dumps(described, indent=2, sort_keys=True) + "\n", encoding="utf-8")
    save_file({name: tensor.detach().cpu().contiguous() for name, tensor in model.state_dict().items()}, folder / WEIGHTS)


def load(folder: Path) -> Sor3d:
    """The model that `save` wrote, on the CPU, in evaluation mode. ValueError says which file, field or tensor does not fit."""
    model = build(read_config(folder), seed=0)
    fill(model, folder)
    return model.eval()


def fill(model: nn.Module, folder: Path) -> None:
    """Put the weights of a saved model into one of its config. ValueError when they do not fit."""
    try:
        model.load_state_dict(load_file(folder / WEIGHTS))
    except (OSError, SafetensorError, RuntimeError) as error:
        raise ValueError(f"{folder / WEIGHTS}: expected the weights that {CONFIG} beside it describes; {error}") from error


def read_config(folder: Path, form: str = FORMAT) -> Sor3dConfig:
    """The config of a saved model of the kind `form`."""
    path = folder / CONFIG
    try:
        fields = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise ValueError(f"{path}: expected the config of a trained sor3d model; {error}") from error
    if not isinstance(fields, dict) or fields.pop("format", None) != form:
        raise ValueError(f"{path}: expected \"format\": \"{form}\"; give the folder of such a model")
    try:
        return Sor3dConfig.from_dict(fields)
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path}: {error}") from error
