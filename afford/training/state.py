"""Where a training stands: steps done, curves so far, the best weights. It can be put away and taken up again."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import torch
from torch import Tensor, nn

from afford.training import checkpoint
from afford.training.events import Point

FILE = "checkpoint.safetensors"


@dataclass
class State:
    """All that a training needs besides its task: with it, it goes on as if it had never been interrupted."""

    step: int = 0
    """steps done"""
    points: list[Point] = field(default_factory=list)
    best_step: int = 0
    best_score: float = -math.inf
    best: dict[str, Tensor] = field(default_factory=dict)
    since_best: int = 0
    """validations since the best one"""
    stopped: bool = False

    def note(self, prefix: str, scalars: Mapping[str, float]) -> None:
        """Keep scalars measured now. FloatingPointError for a loss that is none any more."""
        for name, value in scalars.items():
            if prefix == "train" and not math.isfinite(value):
                raise FloatingPointError(f"step {self.step}: the loss {name} is {value}; lower the learning rate or clip_norm")
            self.points.append(Point(self.step, f"{prefix}.{name}", float(value)))

    def judge(self, score: float, model: nn.Module, patience: int) -> None:
        """Keep the weights when they are the best so far; stop when they have not been for `patience` validations."""
        if score > self.best_score:
            self.best_score, self.best_step, self.since_best = score, self.step, 0
            self.best = {name: tensor.detach().clone() for name, tensor in checkpoint.weights(model).items()}
        else:
            self.since_best += 1
        self.stopped = 0 < patience <= self.since_best

    def save(self, folder: Path, model: nn.Module, optimiser: torch.optim.Optimizer) -> None:
        """Put the training away."""
        parts = {"now": checkpoint.weights(model), "best": self.best, "moments": checkpoint.moments(optimiser)}
        tensors = {f"{part}/{name}": tensor for part, found in parts.items() for name, tensor in found.items()}
        words = {"step": self.step, "points": self.points, "best_step": self.best_step, "best_score": self.best_score,
                 "since_best": self.since_best, "stopped": self.stopped}
        checkpoint.save(folder / FILE, tensors, words)


def resume(folder: Path, model: nn.Module, optimiser: torch.optim.Optimizer, device: str) -> State:
    """The state in `folder`, its weights put into the model; a new one where there is none."""
    if not (folder / FILE).exists():
        return State()
    tensors, words = checkpoint.load(folder / FILE)
    parts: dict[str, dict[str, Tensor]] = {"now": {}, "best": {}, "moments": {}}
    for name, tensor in tensors.items():
        part, _, rest = name.partition("/")
        parts[part][rest] = tensor
    checkpoint.restore(model, parts["now"])
    checkpoint.restore_moments(optimiser, parts["moments"])
    best = {name: tensor.to(device) for name, tensor in parts["best"].items()}
    points = [Point(*point) for point in words.pop("points")]
    return State(points=points, best=best, **words)
