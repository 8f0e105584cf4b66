"""A model as a folder: config.json, model.safetensors and, for models with backbones, their architectures and tokenizer.

Nothing is ever unpickled, and nothing is loaded that does not fit: every missing, extra or misshaped tensor is named.
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

from safetensors import SafetensorError
from safetensors.torch import load_file, save_file

from afford.models.fitting import fit
from afford.twohands.model.build import build
from afford.twohands.model.config import ModelConfig
from afford.twohands.model.model import TwoHands

CONFIG, WEIGHTS, FORMAT = "config.json", "model.safetensors", "afford-twohands-1"
INSIDE = "model"
"""where a training keeps the model, beside its card and curves"""


def save(model: TwoHands, folder: Path) -> None:
    """Write a model; the same weights give the same bytes, wherever its backbones came from."""
    folder.mkdir(parents=True, exist_ok=True)
    own = dataclasses.replace(model.config, backbones="")
    described = {"format": FORMAT, **dataclasses.asdict(own)}
    texts = {CONFIG: json.dumps(described, indent=2, sort_keys=True) + "\n", **model.extra_files()}
    for name, text in texts.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    save_file({name: tensor.detach().cpu().contiguous() for name, tensor in model.state_dict().items()}, folder / WEIGHTS)


def place(folder: Path) -> Path:
    """Where the files of a model are: the folder itself, or `model/` in what a training published."""
    return folder if (folder / CONFIG).is_file() or not (folder / INSIDE / CONFIG).is_file() else folder / INSIDE


def load(folder: Path) -> TwoHands:
    """The model that `save` wrote, or that a training published, on the CPU, in evaluation mode.

    ValueError says which file, field or tensor does not fit.
    """
    folder = place(folder)
    config = read_config(folder)
    try:
        weights = load_file(folder / WEIGHTS)
    except (OSError, SafetensorError) as error:
        raise ValueError(f"{folder / WEIGHTS}: expected the weights of a model as safetensors; {error}") from error
    model = build(config, seed=0, pretrained=False)
    fit(model, weights, str(folder / WEIGHTS), "it is the file of another model")
    return model.eval()


def read_config(folder: Path) -> ModelConfig:
    """The config of a saved model, with `backbones` pointing at the architectures beside it."""
    path = folder / CONFIG
    try:
        fields = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise ValueError(f"{path}: expected the config of a trained two-hand model; {error}") from error
    if not isinstance(fields, dict) or fields.pop("format", None) != FORMAT:
        raise ValueError(f"{path}: expected \"format\": \"{FORMAT}\"; write the folder with files.save")
    try:
        config = ModelConfig.from_dict(fields)
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path}: {error}") from error
    return config if config.variant == "small" else dataclasses.replace(config, backbones=str(folder))
