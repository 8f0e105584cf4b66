"""A trained scorer as files: config.json, model.safetensors, and a card that says what it can and cannot do."""

from __future__ import annotations

import dataclasses
import json
import shutil
from pathlib import Path

import torch
from safetensors.torch import save_file

from afford.models.loading import fill_from_file, read_config
from afford.surface.parts.model import Parts, PartsConfig
from schemas.files import FileTree

CONFIG, WEIGHTS, CARD, FORMAT = "config.json", "model.safetensors", "card.md", "afford-parts-2"


def write(scratch: Path, model: Parts, card: str) -> Path:
    """The folder of files; what a training left of curves comes along."""
    root = scratch / "out"
    shutil.rmtree(root, ignore_errors=True)
    root.mkdir(parents=True)
    described = {"format": FORMAT, **dataclasses.asdict(model.config)}
    (root / CONFIG).write_text(json.dumps(described, indent=2, sort_keys=True) + "\n", encoding="utf-8")
    save_file({name: tensor.detach().cpu().contiguous() for name, tensor in model.state_dict().items()}, root / WEIGHTS)
    (root / CARD).write_text(card, encoding="utf-8")
    if (scratch / "tensorboard").exists():
        shutil.copytree(scratch / "tensorboard", root / "tensorboard")
    return root


def read(files: FileTree) -> Parts:
    """The scorer that `write` wrote; ValueError says which file does not fit."""
    config, weights = (_file(files, name) for name in (CONFIG, WEIGHTS))
    where = f"{CONFIG} of {files.name}"
    sizes = read_config(config, PartsConfig, FORMAT, where, "train a scorer with scorer_train")
    with torch.device("meta"):
        model = Parts(sizes)
    return fill_from_file(model, weights, f"{WEIGHTS} of {files.name}")


def _file(files: FileTree, name: str) -> Path:
    found = files.find(name)
    if found is None:
        there = ", ".join(file.name for file in files.files) or "no file"
        raise ValueError(f"{files.name}: expected {name} of a trained scorer, got {there}")
    return found.path
