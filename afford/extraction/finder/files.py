"""A trained finder of hands as files: config.json, model.safetensors, and a card that says what it can and cannot do."""

from __future__ import annotations

import dataclasses
import json
import shutil
from pathlib import Path

import torch
from safetensors.torch import save_file

from afford.extraction.finder.model import Hands, HandsConfig
from afford.models.loading import fill_from_file, read_config
from schemas.files import FileTree

CONFIG, WEIGHTS, CARD, FORMAT = "config.json", "model.safetensors", "card.md", "afford-hands-2"
KEPT = ("tensorboard", "previews")


def write(scratch: Path, model: Hands, card: str) -> Path:
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


def read(where: Path | FileTree) -> Hands:
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
