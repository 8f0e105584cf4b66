"""A job and a folder of samples -> a trained model, in this process."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from torch import nn

from afford.training.job import Job
from afford.training.loop import train
from afford.training.ranks import ALONE, Ranks
from afford.training.state import State
from afford.training.task import Batch, Progress


@dataclass(frozen=True)
class Fitted:
    """A model with its best weights, what validation found in its config, and how it came about."""

    model: nn.Module
    state: State


def fit(job: Job[Batch], scratch: Path, progress: Progress, ranks: Ranks = ALONE) -> Fitted:
    """Train, or go on where `scratch` says that an earlier process stopped. `job.prepare` comes first."""
    task = job.task(scratch, ranks.count)
    state = train(task, job.plan, scratch, progress, ranks)
    job.finish(task.model, state)
    return Fitted(task.model, state)
