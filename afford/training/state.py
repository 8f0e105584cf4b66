"""State of a training and its checkpoint: one safetensors file of weights, optimizer moments, curves and counters."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from blake3 import blake3
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from afford.training.curves import Point

FILE = "checkpoint.safetensors"
METADATA = "words"
"""entry of the safetensors header that holds the checksum and the JSON metadata"""


@dataclass
class TrainingState:
    """State of a training besides its task; a training that resumes from it ends as if it had never been interrupted."""

    step: int = 0
    """finished steps"""
    points: list[Point] = field(default_factory=list)
    """scalars logged so far"""
    best_step: int = 0
    best_score: float = -math.inf
    best: dict[str, Tensor] = field(default_factory=dict)
    """weights of the best validation"""
    since_best: int = 0
    """validations since the best one"""
    stopped: bool = False
    """set by early stopping"""

    def log(self, prefix: str, scalars: Mapping[str, float]) -> None:
        """Record scalars of the current step. FloatingPointError for a training loss that is not finite."""
        for name, value in scalars.items():
            if prefix == "train" and not math.isfinite(value):
                raise FloatingPointError(f"step {self.step}: the loss {name} is {value}; lower the learning rate or clip_norm")
            self.points.append(Point(self.step, f"{prefix}.{name}", float(value)))

    def update_best(self, score: float, model: nn.Module, patience: int) -> None:
        """Keep the weights of the best score; stop after `patience` validations without a better one (0: never)."""
        if score > self.best_score:
            self.best_score, self.best_step, self.since_best = score, self.step, 0
            self.best = {name: tensor.detach().clone() for name, tensor in trained_weights(model).items()}
        else:
            self.since_best += 1
        self.stopped = 0 < patience <= self.since_best

    def save(self, folder: Path, model: nn.Module, optimizer: torch.optim.Optimizer) -> None:
        """Write the checkpoint."""
        parts = {"now": trained_weights(model), "best": self.best, "moments": optimizer_state(optimizer)}
        tensors = {f"{part}/{name}": tensor for part, found in parts.items() for name, tensor in found.items()}
        metadata = {"step": self.step, "points": self.points, "best_step": self.best_step, "best_score": self.best_score,
                    "since_best": self.since_best, "stopped": self.stopped}  # fmt: skip
        save_checkpoint(folder / FILE, tensors, metadata)


def resume(folder: Path, model: nn.Module, optimizer: torch.optim.Optimizer, device: str) -> TrainingState:
    """Restore model, optimizer and state from the checkpoint in `folder`; a new state without one."""
    if not (folder / FILE).exists():
        return TrainingState()
    tensors, metadata = load_checkpoint(folder / FILE)
    parts: dict[str, dict[str, Tensor]] = {"now": {}, "best": {}, "moments": {}}
    for name, tensor in tensors.items():
        part, _, rest = name.partition("/")
        parts[part][rest] = tensor
    restore_weights(model, parts["now"])
    restore_optimizer(optimizer, parts["moments"])
    best = {name: tensor.to(device) for name, tensor in parts["best"].items()}
    points = [Point(*point) for point in metadata.pop("points")]
    return TrainingState(points=points, best=best, **metadata)


def save_checkpoint(path: Path, tensors: Mapping[str, Tensor], metadata: Mapping[str, Any]) -> None:
    """Write tensors and JSON metadata, with a checksum of both, atomically: after a kill the previous file is intact."""
    partial = path.with_name(f"{path.name}.partial")
    kept, text = {name: tensor.detach().contiguous().cpu() for name, tensor in tensors.items()}, json.dumps(metadata)
    save_file(kept, partial, {METADATA: json.dumps([_checksum(kept, text), text])})  # one entry, because their order is not fixed
    os.replace(partial, path)


def load_checkpoint(path: Path) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Read tensors and metadata of a checkpoint. ValueError for a damaged file, which is moved aside."""
    try:
        with safe_open(path, framework="pt") as file:
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
            check, text = json.loads(file.metadata()[METADATA])
        if check != _checksum(tensors, text):
            raise KeyError("its checksum does not match its contents")
        return tensors, dict(json.loads(text))
    except (SafetensorError, KeyError, TypeError, ValueError) as error:
        aside = path.replace(path.with_name(f"{path.name}.damaged"))
        raise ValueError(f"{path.name}: the checkpoint is damaged ({error}) and was moved to {aside.name}; run again to train from "
                         "the beginning") from error  # fmt: skip


def _checksum(tensors: Mapping[str, Tensor], metadata: str) -> str:
    digest = blake3(metadata.encode())
    for name in sorted(tensors):
        digest.update(f"{name} {tensors[name].dtype} {tuple(tensors[name].shape)}".encode())
        digest.update(tensors[name].reshape(-1).view(torch.uint8).numpy().data)
    return digest.hexdigest()


def trained_weights(model: nn.Module) -> dict[str, Tensor]:
    """State dict of a model without its frozen parameters: trainable parameters and persistent buffers."""
    frozen = {name for name, parameter in model.named_parameters() if not parameter.requires_grad}
    return {name: tensor for name, tensor in model.state_dict().items() if name not in frozen}


def restore_weights(model: nn.Module, tensors: Mapping[str, Tensor]) -> None:
    """Copy weights into a model. ValueError names tensors that the model or the checkpoint lacks."""
    own = trained_weights(model)
    wrong = sorted(own.keys() ^ tensors.keys())
    if wrong:
        raise ValueError(f"checkpoint: its weights are not those of this model; they differ in {', '.join(wrong[:4])}")
    with torch.no_grad():
        for name, tensor in own.items():
            tensor.copy_(tensors[name])


def optimizer_state(optimizer: torch.optim.Optimizer) -> dict[str, Tensor]:
    """Tensors of an optimizer's state by '<parameter number>.<name>'."""
    state = optimizer.state_dict()["state"]
    return {f"{number}.{name}": tensor for number, kept in state.items() for name, tensor in kept.items()}


def restore_optimizer(optimizer: torch.optim.Optimizer, tensors: Mapping[str, Tensor]) -> None:
    """Load the tensors of `optimizer_state`."""
    state: dict[int, dict[str, Tensor]] = {}
    for name, tensor in tensors.items():
        number, _, key = name.partition(".")
        state.setdefault(int(number), {})[key] = tensor
    optimizer.load_state_dict({"state": state, "param_groups": optimizer.state_dict()["param_groups"]})
