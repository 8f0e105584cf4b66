"""DAgger (Ross et al. 2011): the student acts, the teacher says what it would have done there, the student learns that.

As in AffordDex: a first-in first-out buffer, the mean squared error on mean actions, Adam. Unlike it: episodes are finished before
they are learned from, the teacher acts in a falling share of the worlds in the first rounds (beta of the original), and minibatches
are a fixed number (its: 5 passes over the buffer in 4 minibatches, after every step).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
from torch import Tensor, nn

from afford.grasping.rl.cloud_policy import CloudPolicy

Seen = Sequence[np.ndarray]
"""what a student sees, (n, ...) each: its robot's numbers first"""


@dataclass(frozen=True)
class Config:
    """What DAgger can be told."""

    rounds: int = 40
    """episodes in every world, each followed by learning"""
    updates: int = 80
    """minibatches of a round"""
    batch: int = 128
    """moments in a minibatch"""
    buffer: int = 9600
    """moments that are remembered"""
    led: int = 6
    """rounds over which the teacher's share of the worlds falls from all to none; 0 for never any"""
    lr: float = 1e-3
    """of Adam; it falls to 0 towards the last round"""
    max_grad_norm: float = 1.0
    """gradients are scaled down to it"""
    seed: int = 0
    """of the worlds that are led and of minibatches"""


class Worlds(Protocol):
    """n worlds with a teacher beside the student. Actions are the student's own."""

    steps: int
    """of an episode"""

    def begin(self, round_: int) -> Seen:
        """Begin round `round_` everywhere; the same number begins the same way."""
        ...

    def label(self) -> np.ndarray:
        """(n, a) what the teacher would do now."""
        ...

    def step(self, action: np.ndarray) -> Seen:
        """Act (n, a)."""
        ...

    def report(self) -> dict[str, np.ndarray]:
        """(n,) figures of the episodes that have come to their end."""
        ...


class Buffer:
    """The last moments and their labels."""

    def __init__(self, size: int) -> None:
        self.size, self.columns = size, list[np.ndarray]()
        self.count = 0
        """moments that ever came in"""

    def add(self, *columns: np.ndarray) -> None:
        """(n, ...) each."""
        if not self.columns:
            self.columns = [np.zeros((self.size, *column.shape[1:]), column.dtype) for column in columns]
        at = (self.count + np.arange(len(columns[0]))) % self.size
        for kept, column in zip(self.columns, columns, strict=True):
            kept[at] = column
        self.count += len(columns[0])

    def draw(self, rng: np.random.Generator, count: int) -> list[Tensor]:
        """`count` of those that are there, anyhow."""
        at = rng.integers(min(self.count, self.size), size=count)
        return [torch.from_numpy(column[at]) for column in self.columns]


def learn(worlds: Worlds, model: CloudPolicy, config: Config, optimiser: torch.optim.Optimizer, buffer: Buffer, first: int,
          each: Callable[[int, dict[str, float]], None]) -> None:  # fmt: skip
    """Train from round `first` on; `each(round, scalars)` is called after every one. What a round draws depends on its number."""
    for number in range(first, config.rounds):
        rng = np.random.default_rng([config.seed, number])
        torch.manual_seed(int(rng.integers(2**62)))
        for group in optimiser.param_groups:
            group["lr"] = config.lr * (1 - number / config.rounds)
        scalars = collect(worlds, model, config, buffer, number, rng)
        each(number, scalars | improve(model, config, optimiser, buffer, rng))


@torch.no_grad()
def collect(worlds: Worlds, model: CloudPolicy, config: Config, buffer: Buffer, number: int,
            rng: np.random.Generator) -> dict[str, float]:  # fmt: skip
    """An episode in every world; the mean of each figure over those that the student led, and the teacher's share."""
    model.eval()
    seen = worlds.begin(number)
    share = max(0.0, 1 - number / config.led) if config.led else 0.0
    led = np.arange(len(seen[0])) < round(share * len(seen[0]))
    rng.shuffle(led)
    robots = []
    for _ in range(worlds.steps):
        label = worlds.label()
        buffer.add(*seen, label.astype(np.float32))
        robots.append(seen[0])
        chosen = label if led.all() else np.where(led[:, None], label, model(*map(torch.from_numpy, seen)).numpy())
        seen = worlds.step(chosen)
    model.seen.update(torch.from_numpy(np.concatenate(robots)))
    report = {name: figure[~led & ~np.isnan(figure)] for name, figure in worlds.report().items()}
    return {name: float(figure.mean()) for name, figure in report.items() if len(figure)} | {"led": float(led.mean())}


def improve(model: CloudPolicy, config: Config, optimiser: torch.optim.Optimizer, buffer: Buffer,
            rng: np.random.Generator) -> dict[str, float]:  # fmt: skip
    """The mean error of the minibatches of a round."""
    model.train()
    errors = []
    for _ in range(config.updates):
        *seen, label = buffer.draw(rng, config.batch)
        loss = nn.functional.mse_loss(model(*seen), label)
        optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(model.parameters(), config.max_grad_norm)
        optimiser.step()
        errors.append(loss.item())
    return {"error": float(np.mean(errors))}
