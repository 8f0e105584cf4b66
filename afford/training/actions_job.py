"""Everything that decides a pre-training of the first encoder of SOR3D-AFF's model."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torch import nn

from afford.dataset import sequences
from afford.models.sor3d import pretrain
from afford.models.sor3d.model import build
from afford.training import sor3d_card
from afford.training.actions import Actions, ClipBatches
from afford.training.job import Dataset
from afford.training.order import Order
from afford.training.sor3d_job import Sor3dJob, kinds_of, parts_of, spread
from afford.training.sor3d_job import job as sor3d
from afford.training.state import State
from afford.training.task import Plan
from schemas.training import Recipe, TrainingLog


@dataclass(frozen=True)
class ActionsJob:
    """A pre-training (`afford.training.job.Job`) for the model of `whole`."""

    whole: Sor3dJob

    @property
    def plan(self) -> Plan:
        """How the loop trains."""
        return self.whole.plan

    def prepare(self, data: Mapping[str, Path], scratch: Path) -> None:
        """As for the whole model."""
        self.whole.prepare(data, scratch)

    def task(self, scratch: Path, processes: int) -> Actions:
        """The first encoder of a new model with an LSTM, and clips."""
        whole, parts = self.whole, parts_of(scratch)
        labels = [sequences.kind(path)[1] for path in parts["train"]]
        actions = tuple(sorted(set(labels)))
        model = pretrain.head(build(whole.config, whole.seed), len(actions), whole.seed)
        order = Order(labels, whole.balance, whole.seed)
        batches = ClipBatches(parts["train"], whole.config, whole.changes, order, whole.batch, actions, whole.seed)
        return Actions(model, batches, spread(parts["val"], whole.val_samples), whole.plan.device)

    def finish(self, model: nn.Module, state: State) -> None:
        """Validation decides nothing but which weights are kept."""

    def save(self, model: nn.Module, folder: Path) -> None:
        """encoder.safetensors, which `model_train` (backend sor3d) starts from."""
        assert isinstance(model, pretrain.ActionLSTM)
        pretrain.save(model.encoder, folder)

    def card(self, name: str, dataset: Dataset, scratch: Path, model: nn.Module, curves: TrainingLog) -> str:
        """The card, Markdown."""
        count = sum(parameter.numel() for parameter in model.parameters())
        return sor3d_card.text(name, dataset, kinds_of(scratch), dataclasses.asdict(self.whole), count, curves)

    def to_json(self) -> str:
        """The job as text."""
        return json.dumps({**json.loads(self.whole.to_json()), "backend": "sor3d_actions"})

    @classmethod
    def from_fields(cls, fields: dict[str, Any]) -> ActionsJob:
        """The job again."""
        return cls(Sor3dJob.from_fields(fields))


def job(p: Any, recipe: Recipe | None, threads: int) -> ActionsJob:
    """What the stage's parameters `p` say."""
    return ActionsJob(sor3d(p, recipe, threads))
