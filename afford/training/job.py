"""Interfaces between the training loop and a model: the Task that the loop trains and the Job that sets it up.

A job is plain data. It travels as JSON to the processes of a distributed training, which build their tasks from it.
"""

from __future__ import annotations

import importlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Protocol, TypeVar

from torch import Tensor, nn

from afford.training.params import Plan
from afford.training.state import TrainingState
from schemas.training import TrainingLog

DYNAMIC = ()  # the class of a job belongs to the code of the stage that makes the job

Progress = Callable[[int, int], None]
"""called with (finished steps, all steps)"""
Batch = TypeVar("Batch")
"""one micro-batch, opaque to the loop"""


class Task(Protocol[Batch]):
    """A model, its batches, its loss and its validation. All of them depend on the task's seed and their arguments only."""

    model: nn.Module
    monitor: str
    """the scalar of `validate` that is maximised: its best value decides which weights are kept"""

    def batch(self, number: int) -> Batch:
        """Micro-batch `number`, counted over the whole training; called in threads that prefetch."""

    def loss(self, model: nn.Module, batch: Batch) -> Mapping[str, Tensor]:
        """Named scalars; `total` is minimised. `model` is `self.model` or a wrapper of it."""

    def validate(self) -> Mapping[str, float]:
        """Named validation scores of the current model."""

    def preview(self, folder: Path, step: int) -> None:
        """Write pictures of the current predictions."""


class Job(Protocol[Batch]):
    """Configuration of a training: model, data and plan."""

    @property
    def plan(self) -> Plan:
        """Optimizer, schedule and validation of the loop."""

    def prepare(self, data: Mapping[str, Path], scratch: Path) -> None:
        """Write to `scratch` what `task` reads, from the data set's files by name. ValueError when a split is empty."""

    def task(self, scratch: Path, processes: int) -> Task[Batch]:
        """Build a new model with its batches."""

    def finish(self, model: nn.Module, state: TrainingState) -> None:
        """Write into the model's config the values that validation chose at the best step."""

    def save(self, model: nn.Module, folder: Path, scratch: Path) -> None:
        """Write the model's files; `scratch` is the folder of `prepare`."""

    def card(self, name: str, dataset: Dataset, scratch: Path, model: nn.Module, curves: TrainingLog) -> str:
        """Markdown card of the trained model."""

    def to_json(self) -> str:
        """JSON of the job's fields and of `job`, the "module:class" that reads them."""

    @classmethod
    def from_fields(cls, fields: dict[str, object]) -> Job[Batch]:
        """Build the job from the fields of its JSON, without `job`."""


class Dataset(Protocol):
    """Facts about a data set that a model card reports."""

    @property
    def name(self) -> str:
        """Name of the data set."""

    @property
    def digest(self) -> str:
        """Content digest."""

    @property
    def licence(self) -> str:
        """Licence, 'unknown' when the data set's card has none."""


def read_job(text: str) -> Job[object]:
    """Build the job that `to_json` wrote."""
    fields = json.loads(text)
    module, _, name = fields.pop("job").partition(":")
    job: Job[object] = getattr(importlib.import_module(module), name).from_fields(fields)
    return job
