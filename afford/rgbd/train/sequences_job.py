"""What trainings share that learn from the sequences of an RGB-D data set, whatever network learns."""

from __future__ import annotations

import dataclasses
import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Self

from torch import nn

from afford.dataset import packed_sequences
from afford.rgbd.model.config import ROWS, VARIANTS, Sor3dConfig, row
from afford.rgbd.model.losses import LossParams
from afford.rgbd.model.sequence_batches import Changes
from afford.rgbd.train import sor3d_card
from afford.training.job import Dataset
from afford.training.params import Optimisation, Plan, plan_of
from afford.training.sampler import BalancedSampler
from afford.training.state import TrainingState
from schemas.training import TrainingLog

FILES = "sequences.json"
ADAM = (0.9, 0.999)
"""the moments of Adam, which the paper uses as they are"""


@dataclass(frozen=True)
class SequencesJob:
    """A network, what it learns from, and how (`afford.training.job.Job`); each subclass brings its task and its files."""

    JOB: ClassVar[str]
    """"module:class" of the class, which reads its JSON"""
    WHAT: ClassVar[str]
    """what its card says that was trained"""

    config: Sor3dConfig
    plan: Plan
    changes: Changes
    batch: int
    """sequences per micro-batch and process"""
    balance: float
    """0: sequences as they are; 1: every affordance of every object type as often as any other"""
    val_samples: int
    """sequences that judge, spread over all of them"""
    seed: int

    def prepare(self, data: Mapping[str, Path], scratch: Path) -> None:
        """Note where the sequences of both parts are; they are read when they are drawn."""
        found = {split: [str(path.absolute()) for path in packed_sequences.split_files(data, split)] for split in ("train", "val")}
        (scratch / FILES).write_text(json.dumps(found), encoding="utf-8")

    def order(self, paths: list[Path]) -> BalancedSampler:
        """Which sequence of training comes when."""
        return BalancedSampler([packed_sequences.read_classes(path) for path in paths], self.balance, self.seed)

    def finish(self, model: nn.Module, state: TrainingState) -> None:
        """Validation decides nothing but which weights are kept."""

    def card(self, name: str, dataset: Dataset, scratch: Path, model: nn.Module, curves: TrainingLog) -> str:
        """The card, Markdown."""
        count = sum(parameter.numel() for parameter in model.parameters())
        return sor3d_card.text(name, dataset, kinds_of(scratch), dataclasses.asdict(self), count, curves, self.WHAT)

    def to_json(self) -> str:
        """The job as text."""
        return json.dumps({"job": self.JOB, **dataclasses.asdict(self)})

    @classmethod
    def from_fields(cls, fields: dict[str, Any]) -> Self:
        """The job again."""
        kinds: dict[str, type] = {"config": Sor3dConfig, "plan": Plan, "loss": LossParams, "changes": Changes}
        return cls(**{name: kinds[name](**_tuples(part)) if name in kinds else part for name, part in fields.items()})


def config_of(stage: str, variant: str, of_row: str, size_px: int, batch: int) -> Sor3dConfig:
    """The model of a variant and a row. ValueError, which names the stage, for one of them that is not known, and for a batch too
    small to normalise over.
    """
    if variant not in VARIANTS or of_row not in ROWS:
        raise ValueError(f"{stage}: expected variant of {', '.join(VARIANTS)} and row of {', '.join(ROWS)}, got {variant!r}, "
                         f"{of_row!r}")
    if variant == "small" and batch < 2:
        raise ValueError(f"{stage}: expected a batch of 2 or more for small, which normalises over it, got {batch}")
    return row(replace(VARIANTS[variant](), size_px=size_px), of_row)


def adam_plan(p: Optimisation) -> Plan:
    """The plan that the parameters of a stage describe, with the moments of the paper."""
    return replace(plan_of(p), betas=ADAM)


def spread(paths: list[Path], count: int) -> list[Path]:
    """At most `count` of them, spread over all."""
    count = min(count, len(paths))
    return [paths[round(n * (len(paths) - 1) / max(count - 1, 1))] for n in range(count)]


def kinds_of(scratch: Path) -> dict[str, Counter[str]]:
    """Sequences of both parts by '<object type> <affordance>'."""
    return {split: Counter(" ".join(packed_sequences.read_classes(path)).strip() for path in paths)
            for split, paths in parts_of(scratch).items()}  # fmt: skip


def parts_of(scratch: Path) -> dict[str, list[Path]]:
    """The files of both parts, as `prepare` found them."""
    found = json.loads((scratch / FILES).read_text(encoding="utf-8"))
    return {split: [Path(path) for path in paths] for split, paths in found.items()}


def _tuples(fields: dict[str, Any]) -> dict[str, Any]:
    return {name: tuple(value) if isinstance(value, list) else value for name, value in fields.items()}
