"""A trained student as files: student.json, student.safetensors."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from afford.grasping.policies.cameras import Rig
from afford.grasping.policies.sight import Eyes
from afford.grasping.policies.student import Senses
from afford.grasping.rl.cloud_policy import CloudConfig, CloudPolicy
from afford.grasping.rl.saved import load_weights, save_weights
from schemas.files import FileTree

CONFIG, WEIGHTS, FORMAT = "student.json", "student.safetensors", "afford-student-1"


def write(root: Path, model: CloudPolicy, senses: Senses, facts: Mapping[str, Any]) -> None:
    """Into the folder `root`; `facts` are those of its teacher (afford.grasping.rl.saved)."""
    root.mkdir(parents=True, exist_ok=True)
    described = {"format": FORMAT, "network": asdict(model.config), "senses": asdict(senses), "facts": dict(facts)}
    (root / CONFIG).write_text(json.dumps(described, indent=2, sort_keys=True) + "\n", encoding="utf-8")
    save_weights(root / WEIGHTS, model)


def read(files: FileTree) -> tuple[CloudPolicy, Senses, dict[str, Any]]:
    """What `write` wrote. ValueError says which file does not fit."""
    found = {name: files.find(name) for name in (CONFIG, WEIGHTS)}
    if missing := [name for name, file in found.items() if file is None]:
        there = ", ".join(file.name for file in files.files) or "no file"
        raise ValueError(f"{files.name}: expected {missing[0]} of a trained student, got {there}")
    config, weights = (file.path for file in found.values() if file is not None)
    described = json.loads(config.read_text(encoding="utf-8"))
    if described.get("format") != FORMAT:
        raise ValueError(f'{CONFIG} of {files.name}: expected "format": "{FORMAT}", got {described.get("format")!r}; '
                         f"train a student anew")
    network, senses = described["network"], described["senses"]
    model = CloudPolicy(CloudConfig(**{**network, "points": tuple(network["points"]), "hidden": tuple(network["hidden"])}))
    load_weights(weights, model)
    return model.eval(), Senses(Rig(**senses["rig"]), Eyes(**senses["eyes"]), senses["n_t"]), described["facts"]
