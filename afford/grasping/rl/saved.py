"""A trained policy as files: policy.json, policy.safetensors."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import nn

from afford.grasping.rl.policy import ActorCritic, PolicyConfig
from schemas.files import FileTree

CONFIG, WEIGHTS, FORMAT = "policy.json", "policy.safetensors", "afford-policy-1"


def write(root: Path, model: ActorCritic, facts: Mapping[str, Any]) -> None:
    """Into the folder `root`; `facts` is what somebody who runs the policy must know: role, layout, rates, ..."""
    root.mkdir(parents=True, exist_ok=True)
    described = {"format": FORMAT, "network": dataclasses.asdict(model.config), "facts": dict(facts)}
    (root / CONFIG).write_text(json.dumps(described, indent=2, sort_keys=True) + "\n", encoding="utf-8")
    save_weights(root / WEIGHTS, model)


def read(files: FileTree, under: str = "") -> tuple[ActorCritic, dict[str, Any]]:
    """What `write` wrote into the folder `under` of the files, and its facts. ValueError says which file does not fit."""
    described = json.loads(_file(files, under + CONFIG).read_text(encoding="utf-8"))
    if described.get("format") != FORMAT:
        raise ValueError(f'{under}{CONFIG} of {files.name}: expected "format": "{FORMAT}", got {described.get("format")!r}; '
                         f"train a policy anew")
    network = described["network"]
    model = ActorCritic(PolicyConfig(**{**network, "hidden": tuple(network["hidden"])}))
    load_weights(_file(files, under + WEIGHTS), model)
    return model.eval(), described["facts"]


def save_weights(path: Path, model: nn.Module) -> None:
    """All parameters and buffers."""
    save_file({name: tensor.detach().cpu().contiguous() for name, tensor in model.state_dict().items()}, path)


def load_weights(path: Path, model: nn.Module) -> None:
    """The same back; ValueError when they are those of another network."""
    try:
        model.load_state_dict(load_file(path))
    except (SafetensorError, RuntimeError) as error:
        raise ValueError(f"{path.name}: expected the weights that {CONFIG} beside it describes; {error}") from error


def _file(files: FileTree, name: str) -> Path:
    found = files.find(name)
    if found is None:
        there = ", ".join(file.name for file in files.files) or "no file"
        raise ValueError(f"{files.name}: expected {name} of a trained policy, got {there}")
    return found.path
