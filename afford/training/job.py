"""What a training is, as plain data that travels to the processes that do it. What differs between models is here; steps,
checkpoints, resuming, curves and files are the same for all (`fit`, `loop`, `written`).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

from torch import nn

from afford.common.registry import load
from afford.training.state import State
from afford.training.task import Batch, Plan, Task
from schemas.training import TrainingLog


class Job(Protocol[Batch]):
    """A model, what it learns from, and how."""

    @property
    def plan(self) -> Plan:
        """How the loop trains."""

    def prepare(self, data: Mapping[str, Path], scratch: Path) -> None:
        """Make ready in `scratch` what `task` reads, from the files of the data set by name. ValueError when a part is empty."""

    def task(self, scratch: Path, processes: int) -> Task[Batch]:
        """A new model and what it learns from."""

    def finish(self, model: nn.Module, state: State) -> None:
        """Write into the model's config what validation found at the best step."""

    def save(self, model: nn.Module, folder: Path, scratch: Path) -> None:
        """The model as files; `scratch` is where `prepare` made things ready."""

    def card(self, name: str, dataset: Dataset, scratch: Path, model: nn.Module, curves: TrainingLog) -> str:
        """The card of the trained model, Markdown."""

    def to_json(self) -> str:
        """The job as text: its fields, and `job`, the "module:class" that reads them."""

    @classmethod
    def from_fields(cls, fields: dict[str, object]) -> Job[Batch]:
        """The job again, of what its JSON says beside its class."""


class Dataset(Protocol):
    """What a card says of the data set as a whole."""

    @property
    def name(self) -> str:
        """Its name."""

    @property
    def digest(self) -> str:
        """Its content digest."""

    @property
    def licence(self) -> str:
        """Its licence, 'unknown' where it says none."""


def read(text: str) -> Job[object]:
    """The job that `to_json` wrote."""
    fields = json.loads(text)
    found: Job[object] = load({"job": fields.pop("job")}, "job").from_fields(fields)
    return found
