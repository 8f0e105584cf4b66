"""Trained policy as files: policy.json (network and facts) and policy.safetensors (weights)."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import nn

from afford.grasping.rl.ppo import ActorCritic, PolicyConfig
from schemas.files import FileTree

CONFIG, WEIGHTS, FORMAT = "policy.json", "policy.safetensors", "afford-policy-1"


def write_policy(root: Path, model: ActorCritic, facts: Mapping[str, Any]) -> None:
    """Write a policy into the folder `root`; `facts` describe the environment it needs: role, layout, rates, ..."""
    root.mkdir(parents=True, exist_ok=True)
    described = {"format": FORMAT, "network": dataclasses.asdict(model.config), "facts": dict(facts)}
    (root / CONFIG).write_text(json.dumps(described, indent=2, sort_keys=True) + "\n", encoding="utf-8")
    save_weights(root / WEIGHTS, model)


def read_policy(files: FileTree, under: str = "") -> tuple[ActorCritic, dict[str, Any]]:
    """Read a policy from the folder `under` of the files: the network in evaluation mode, and its facts.

    ValueError names the file that is missing or does not fit.
    """
    described = json.loads(_file(files, under + CONFIG).read_text(encoding="utf-8"))
    if described.get("format") != FORMAT:
        raise ValueError(f'{under}{CONFIG} of {files.name}: expected "format": "{FORMAT}", got {described.get("format")!r}; '
                         f"train the policy again")
    network = described["network"]
    model = ActorCritic(PolicyConfig(**{**network, "hidden": tuple(network["hidden"])}))
    load_weights(_file(files, under + WEIGHTS), model)
    return model.eval(), described["facts"]


def save_weights(path: Path, model: nn.Module) -> None:
    """Save all parameters and buffers as safetensors."""
    save_file({name: tensor.detach().cpu().contiguous() for name, tensor in model.state_dict().items()}, path)


def load_weights(path: Path, model: nn.Module) -> None:
    """Load parameters and buffers into `model`. ValueError for the weights of another network."""
    try:
        model.load_state_dict(load_file(path))
    except (SafetensorError, RuntimeError) as error:
        raise ValueError(f"{path.name}: expected the weights of the network in {CONFIG}; {error}") from error


def _file(files: FileTree, name: str) -> Path:
    found = files.find(name)
    if found is None:
        there = ", ".join(file.name for file in files.files) or "no file"
        raise ValueError(f"{files.name}: expected {name} of a trained policy, got {there}")
    return found.path
