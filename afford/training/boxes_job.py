"""Everything that decides a training of the detector that SOR3D-AFF's model is compared with on single pictures."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from torch import nn

from afford.dataset import sequences
from afford.models.boxes.model import FORMAT, Boxes, build
from afford.models.sor3d import files
from afford.training import sor3d_card
from afford.training.boxes import Detecting
from afford.training.job import Dataset
from afford.training.order import Order
from afford.training.sequence_batches import SequenceBatches, fitted
from afford.training.sor3d_job import Sor3dJob, kinds_of, parts_of, spread
from afford.training.sor3d_job import job as sor3d
from afford.training.state import State
from afford.training.task import Plan
from schemas.training import Recipe, TrainingLog

WHAT = """A detector after AffordanceNet (Do, Nguyen and Reid 2018), for comparison: an encoder like that of SOR3D-AFF's model,
boxes of things, and inside each box a mask of affordances. One picture goes in. Boxes were learned from the extent of labels."""


@dataclass(frozen=True)
class BoxesJob:
    """A training (`afford.training.job.Job`) on the last frames of what `whole` would learn from."""

    whole: Sor3dJob

    @property
    def plan(self) -> Plan:
        """How the loop trains."""
        return self.whole.plan

    def prepare(self, data: Mapping[str, Path], scratch: Path) -> None:
        """As for the model of sequences."""
        self.whole.prepare(data, scratch)

    def task(self, scratch: Path, processes: int) -> Detecting:
        """A new model, batches of last frames, and those that judge."""
        whole, parts = self.whole, parts_of(scratch)
        order = Order([sequences.kind(path) for path in parts["train"]], whole.balance, whole.seed)
        total = whole.plan.steps * whole.plan.accumulate * processes
        batches = SequenceBatches(parts["train"], whole.config, whole.changes, order, whole.batch, 1.0, total, whole.seed)
        judged = [fitted(sequences.read(path, "none"), whole.config.size_px) for path in spread(parts["val"], whole.val_samples)]
        return Detecting(build(whole.config, whole.seed), batches, judged, whole.plan.device)

    def finish(self, model: nn.Module, state: State) -> None:
        """Validation decides nothing but which weights are kept."""

    def save(self, model: nn.Module, folder: Path) -> None:
        """config.json, model.safetensors."""
        assert isinstance(model, Boxes)
        files.save(model, folder, FORMAT)

    def card(self, name: str, dataset: Dataset, scratch: Path, model: nn.Module, curves: TrainingLog) -> str:
        """The card, Markdown."""
        count = sum(parameter.numel() for parameter in model.parameters())
        return sor3d_card.text(name, dataset, kinds_of(scratch), dataclasses.asdict(self.whole), count, curves, WHAT)

    def to_json(self) -> str:
        """The job as text."""
        return json.dumps({**json.loads(self.whole.to_json()), "backend": "boxes"})

    @classmethod
    def from_fields(cls, fields: dict[str, Any]) -> BoxesJob:
        """The job again."""
        return cls(Sor3dJob.from_fields(fields))


def job(p: Any, recipe: Recipe | None, threads: int) -> BoxesJob:
    """What the stage's parameters `p` say: of the row, whether depth is seen."""
    whole = sor3d(p, recipe, threads)
    return BoxesJob(replace(whole, config=replace(whole.config, flow="none", attention=False), static_share=1.0))
