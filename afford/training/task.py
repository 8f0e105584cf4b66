"""What the loop must know of a task, and what it may be asked to do."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TypeVar

from torch import Tensor, nn

from afford.training.params import Optimisation

Progress = Callable[[int, int], None]
Batch = TypeVar("Batch")
"""what one micro-batch is, of which the loop knows nothing"""


class Task(Protocol[Batch]):
    """A model, what it learns from, and how well it does. Nothing here may depend on anything but its own seed and arguments."""

    model: nn.Module
    judged_by: str
    """the scalar of `validate` of which more is better"""

    def batch(self, number: int) -> Batch:
        """Micro-batch `number`, counted over the whole training; called in threads, ahead of its use."""

    def loss(self, model: nn.Module, batch: Batch) -> Mapping[str, Tensor]:
        """Named scalars; `total` is minimised. `model` is `self.model`, or what wraps it."""

    def validate(self) -> Mapping[str, float]:
        """Named scalars of the model as it is now."""

    def preview(self, folder: Path, step: int) -> None:
        """Write pictures of what the model says now."""


@dataclass(frozen=True)
class Plan:
    """How to train. Micro-batches per step = `accumulate` x number of processes."""

    steps: int
    lr: float = 3e-4
    betas: tuple[float, float] = (0.9, 0.95)
    weight_decay: float = 0.0
    clip_norm: float = 1.0
    warmup: int = 100
    decay: bool = True
    """whether the learning rate falls linearly to 0 after the warm-up"""
    accumulate: int = 1
    bf16: bool = False
    validate_every: int = 0
    """steps between two validations, 0 for none: then the last weights are kept"""
    patience: int = 0
    """validations without a better one before training stops, 0 for never"""
    log_every: int = 10
    seed: int = 0
    device: str = "cpu"
    parallel: int = 1
    """micro-batches of a step that are computed at the same time: for models without dropout, in one process on a CPU"""
    workers: int = 1
    """threads that make batches; no effect on what comes out"""

    def __post_init__(self) -> None:
        if min(self.steps, self.accumulate, self.log_every) < 1 or not 0 < self.warmup <= self.steps:
            raise ValueError(f"training: expected steps, accumulate, log_every >= 1 and 0 < warmup <= steps, got {self}")


def plan_of(p: Optimisation, parallel: int = 1) -> Plan:
    """The plan that the parameters of a stage describe, whatever the model."""
    return Plan(steps=p.steps, lr=p.lr, warmup=min(p.warmup, p.steps), decay=p.decay, weight_decay=p.weight_decay,
                clip_norm=p.clip_norm, accumulate=p.accumulate, bf16=p.bf16, validate_every=p.validate_every,
                patience=p.patience, seed=p.seed, device=p.device, parallel=parallel)  # fmt: skip
