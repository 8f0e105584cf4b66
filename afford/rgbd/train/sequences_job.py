"""What trainings share that learn from the sequences of SOR3D-AFF's model, but another network."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Self

from torch import nn

from afford.rgbd.train import sor3d_card
from afford.rgbd.train.sor3d_job import Sor3dJob, kinds_of
from afford.training.job import Dataset
from afford.training.state import State
from afford.training.task import Plan
from schemas.training import TrainingLog


@dataclass(frozen=True)
class SequencesJob:
    """A training (`afford.training.job.Job`) on what `whole` would learn from; its network and files are those of the class."""

    JOB: ClassVar[str]
    """"module:class" of the class, which reads its JSON"""
    WHAT: ClassVar[str]
    """what its card says that was trained"""

    whole: Sor3dJob

    @property
    def plan(self) -> Plan:
        """How the loop trains."""
        return self.whole.plan

    def prepare(self, data: Mapping[str, Path], scratch: Path) -> None:
        """As for the model of sequences."""
        self.whole.prepare(data, scratch)

    def finish(self, model: nn.Module, state: State) -> None:
        """Validation decides nothing but which weights are kept."""

    def card(self, name: str, dataset: Dataset, scratch: Path, model: nn.Module, curves: TrainingLog) -> str:
        """The card, Markdown."""
        count = sum(parameter.numel() for parameter in model.parameters())
        return sor3d_card.text(name, dataset, kinds_of(scratch), dataclasses.asdict(self.whole), count, curves, self.WHAT)

    def to_json(self) -> str:
        """The job as text."""
        return json.dumps({**json.loads(self.whole.to_json()), "job": self.JOB})

    @classmethod
    def from_fields(cls, fields: dict[str, Any]) -> Self:
        """The job again."""
        return cls(Sor3dJob.from_fields(fields))
