"""A task of two small matrices, for the laws of the training loop."""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor, nn

from afford.training.params import Plan

WIDTH, SAMPLES = 6, 8
PLAN = Plan(steps=24, lr=0.02, warmup=4, validate_every=5, log_every=2, seed=3)


class Toy:
    """Regression with dropout and batch statistics, so that random state and buffers matter."""

    monitor = "fit"

    def __init__(self, size: int = SAMPLES, dropout: float = 0.2, norm: bool = True) -> None:
        torch.manual_seed(1)
        layers = [nn.Linear(WIDTH, 16), *([nn.BatchNorm1d(16)] if norm else []), nn.Dropout(dropout), nn.Linear(16, 1)]
        self.model: nn.Module = nn.Sequential(*layers)
        self.size = size

    def batch(self, number: int) -> tuple[Tensor, Tensor]:
        made = [self.sample(number * self.size + n) for n in range(self.size)]
        x = torch.stack(made)
        return x, x.sum(1, keepdim=True).sin()

    def sample(self, position: int) -> Tensor:
        return torch.randn(WIDTH, generator=torch.Generator().manual_seed(position))

    def loss(self, model: nn.Module, batch: tuple[Tensor, Tensor]) -> dict[str, Tensor]:
        error = (model(batch[0]) - batch[1]).square().mean()
        return {"total": error, "error": error}

    def validate(self) -> dict[str, float]:
        x, y = self.batch(10_000)
        return {"fit": -float((self.model(x) - y).square().mean())}

    def preview(self, folder: Path, step: int) -> None:
        (folder / f"{step}.txt").write_text(str(self.validate()))


def no_progress(done: int, total: int) -> None:
    """Report no progress."""


def bytes_of(model: nn.Module) -> bytes:
    """Bytes of the weights and buffers."""
    return b"".join(tensor.numpy().tobytes() for tensor in model.state_dict().values())
