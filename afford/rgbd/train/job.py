"""Job of a training on RGB-D sequences, and the card of the trained model; each network adds its task and its files."""

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
from afford.rgbd.model.model_inputs import Augmentation
from afford.training.curves import scores_at_best, scores_table
from afford.training.job import Dataset
from afford.training.params import Optimisation, Plan, plan_of
from afford.training.sampler import BalancedSampler
from afford.training.state import TrainingState
from schemas.training import TrainingLog

LIMITS = """- It knows things and actions like those it was trained on. Rendered sequences are tidier than people at tables.
- A region says where an action takes hold of a thing; it promises neither a stable grasp nor that touching is safe.
- The camera must stand: motion is measured against it.
- The validation figures above chose the step, so they flatter."""
WHAT = """SOR3D-AFF's spatio-temporal autoencoder. An RGB-D sequence (or one picture) goes in; which pixels of its last frame afford
what, and the action, come out."""


def card_text(name: str, dataset: Dataset, parts: Mapping[str, Counter[str]], job: dict[str, Any], count: int,
         curves: TrainingLog, what: str = WHAT) -> str:
    """Model card; `parts` are sequences by '<object type> <affordance>', `job` its fields, `what` describes the model."""
    config, plan = job["config"], job["plan"]
    kinds = sorted(set().union(*parts.values()))
    return f"""---
license: {dataset.licence}
library_name: afford
pipeline_tag: image-segmentation
tags:
- affordance
- rgb-d
- video
---

# {name}

{what}

{count:,} parameters.

Depth: {config['depth']}; flow: {config['flow']}; attention: {config['attention']}.

## Data

`{dataset.name}`, content digest `{dataset.digest}`.

| | {' | '.join(parts)} |
|---|{'--:|' * len(parts)}
| sequences | {' | '.join(str(sum(part.values())) for part in parts.values())} |
{_lines(kinds, parts)}

## Training

{curves.steps} of {plan['steps']} steps of {job['batch'] * plan['accumulate']} sequences a process, seed {job['seed']}; the weights
of step {curves.best_step} were kept. Only the label of the last frame is learned, and the action.

```json
{json.dumps({key: value for key, value in job.items() if key not in ('vgg', 'encoder')}, indent=1, sort_keys=True)}
```

## Validation

{scores_table(scores_at_best(curves))}

## Limits

{LIMITS}

The licence is that of the data set.
"""


def _lines(kinds: list[str], parts: Mapping[str, Counter[str]]) -> str:
    return "\n".join(f"| {kind} | {' | '.join(str(part[kind]) for part in parts.values())} |" for kind in kinds)


FILES = "sequences.json"
"""file in the scratch folder with the paths of both splits"""
ADAM = (0.9, 0.999)
"""moments of Adam, its defaults, as in the paper"""


@dataclass(frozen=True)
class SequencesJob:
    """Configuration of a training on sequences (`afford.training.job.Job`)."""

    JOB: ClassVar[str]
    """"module:class" of the subclass, which reads its JSON"""
    WHAT: ClassVar[str]
    """description of the model on its card"""

    config: Sor3dConfig
    plan: Plan
    changes: Augmentation
    batch: int
    """sequences per micro-batch and process"""
    balance: float
    """0: sequences uniformly; 1: every affordance of every object type equally often"""
    val_samples: int
    """sequences of validation, spread evenly over the split"""
    seed: int

    def prepare(self, data: Mapping[str, Path], scratch: Path) -> None:
        """Store the paths of both splits; sequences are read when they are sampled."""
        found = {split: [str(path.absolute()) for path in packed_sequences.split_files(data, split)] for split in ("train", "val")}
        (scratch / FILES).write_text(json.dumps(found), encoding="utf-8")

    def order(self, paths: list[Path]) -> BalancedSampler:
        """Build the sampler of training sequences."""
        return BalancedSampler([packed_sequences.read_classes(path) for path in paths], self.balance, self.seed)

    def finish(self, model: nn.Module, state: TrainingState) -> None:
        """Do nothing: validation only decides which weights are kept."""

    def card(self, name: str, dataset: Dataset, scratch: Path, model: nn.Module, curves: TrainingLog) -> str:
        """Markdown card of the trained model."""
        count = sum(parameter.numel() for parameter in model.parameters())
        return card_text(name, dataset, class_counts(scratch), dataclasses.asdict(self), count, curves, self.WHAT)

    def to_json(self) -> str:
        """JSON of the job."""
        return json.dumps({"job": self.JOB, **dataclasses.asdict(self)})

    @classmethod
    def from_fields(cls, fields: dict[str, Any]) -> Self:
        """Build the job from its JSON fields."""
        kinds: dict[str, type] = {"config": Sor3dConfig, "plan": Plan, "loss": LossParams, "changes": Augmentation}
        return cls(**{name: kinds[name](**_tuples(part)) if name in kinds else part for name, part in fields.items()})


def config_of(stage: str, variant: str, of_row: str, size_px: int, batch: int) -> Sor3dConfig:
    """Config of a variant and a row.

    ValueError, which names the stage, for an unknown variant or row, and for a batch too small for batch normalisation.
    """
    if variant not in VARIANTS or of_row not in ROWS:
        raise ValueError(f"{stage}: expected variant of {', '.join(VARIANTS)} and row of {', '.join(ROWS)}, got {variant!r}, "
                         f"{of_row!r}")
    if variant == "small" and batch < 2:
        raise ValueError(f"{stage}: expected a batch of 2 or more for small, which normalises over it, got {batch}")
    return row(replace(VARIANTS[variant](), size_px=size_px), of_row)


def adam_plan(p: Optimisation) -> Plan:
    """Plan of a stage's parameters, with the paper's moments of Adam."""
    return replace(plan_of(p), betas=ADAM)


def spread_evenly(paths: list[Path], count: int) -> list[Path]:
    """Paths spread evenly over all, at most `count`."""
    count = min(count, len(paths))
    return [paths[round(n * (len(paths) - 1) / max(count - 1, 1))] for n in range(count)]


def class_counts(scratch: Path) -> dict[str, Counter[str]]:
    """Number of sequences of both splits by '<object type> <affordance>'."""
    return {split: Counter(" ".join(packed_sequences.read_classes(path)).strip() for path in paths)
            for split, paths in split_paths(scratch).items()}  # fmt: skip


def split_paths(scratch: Path) -> dict[str, list[Path]]:
    """Paths of both splits, from the file of `prepare`."""
    found = json.loads((scratch / FILES).read_text(encoding="utf-8"))
    return {split: [Path(path) for path in paths] for split, paths in found.items()}


def _tuples(fields: dict[str, Any]) -> dict[str, Any]:
    return {name: tuple(value) if isinstance(value, list) else value for name, value in fields.items()}
