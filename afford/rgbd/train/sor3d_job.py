"""Everything that decides a training of SOR3D-AFF's model."""

from __future__ import annotations

import dataclasses
import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from torch import nn

from afford.dataset.sor3d import sequences
from afford.rgbd.model import files, pretrain, vgg
from afford.rgbd.model.config import ROWS, VARIANTS, Sor3dConfig, row
from afford.rgbd.model.losses import LossParams
from afford.rgbd.model.model import Sor3d, build
from afford.rgbd.model.sequence_batches import Changes, SequenceBatches, fitted
from afford.rgbd.train import shares, sor3d_card
from afford.rgbd.train.interactions import Interactions
from afford.training.job import Dataset
from afford.training.order import Order
from afford.training.state import State
from afford.training.task import Plan, plan_of
from schemas.files import FileTree
from schemas.training import Recipe, TrainingLog

FILES = "sequences.json"
ADAM = (0.9, 0.999)
"""the moments of Adam, which the paper uses as they are"""


@dataclass(frozen=True)
class Sor3dJob:
    """A model, what it learns from, and how (`afford.training.job.Job`)."""

    config: Sor3dConfig
    plan: Plan
    loss: LossParams
    changes: Changes
    batch: int
    """sequences per micro-batch and process"""
    static_share: float
    """the last frames of this share of a micro-batch are learned beside it, as pictures"""
    coarse_share: float
    """share of the micro-batches that come first, at half the size: actions are learned there for a third of the price"""
    balance: float
    """0: sequences as they are; 1: every affordance of every object type as often as any other"""
    val_samples: int
    """sequences that judge, spread over all of them"""
    vgg: str
    """a VGG16 checkpoint for the stream of motion, '' for none"""
    seed: int
    encoder: str = ""
    """encoder.safetensors of a pre-training for the first stream, '' for none"""

    def prepare(self, data: Mapping[str, Path], scratch: Path) -> None:
        """Note where the sequences of both parts are; they are read when they are drawn."""
        found = {split: [str(path.absolute()) for path in sequences.part(data, split)] for split in ("train", "val")}
        (scratch / FILES).write_text(json.dumps(found), encoding="utf-8")

    def starting_from(self, files: FileTree) -> Sor3dJob:
        """The same with the encoder that a pre-training left. ValueError when it left none."""
        found = files.find(f"model/{pretrain.FILE}")
        if found is None:
            raise ValueError(f"{files.name}: expected model/{pretrain.FILE} of a pre-training (backend sor3d_actions), found none")
        return replace(self, encoder=str(found.path.absolute()))

    def task(self, scratch: Path, processes: int) -> Interactions:
        """A new model, the batches of training and the sequences of validation."""
        parts = parts_of(scratch)
        model = build(self.config, self.seed)
        if self.config.norm == "batch":
            model.expect(shares.pixels(parts["train"], self.loss.foreground), shares.actions(parts["train"]))
        if self.encoder:
            pretrain.load(model.appearance, Path(self.encoder))
        if self.vgg and model.motion is not None:
            vgg.fill(model.motion, Path(self.vgg))
        order = Order([sequences.kind(path) for path in parts["train"]], self.balance, self.seed)
        total = self.plan.steps * self.plan.accumulate * processes
        batches = SequenceBatches(parts["train"], self.config, self.changes, order, self.batch, self.static_share, total, self.seed,
                                  round(self.coarse_share * total))  # fmt: skip
        chosen = spread(parts["val"], self.val_samples)
        judged = [fitted(sequences.read(path, self.config.flow), self.config.size_px) for path in chosen]
        return Interactions(model, batches, judged, self.loss, self.batch, self.plan.device)

    def finish(self, model: nn.Module, state: State) -> None:
        """Validation decides nothing but which weights are kept."""

    def save(self, model: nn.Module, folder: Path, scratch: Path) -> None:
        """config.json, model.safetensors."""
        files.save(_own(model), folder)

    def card(self, name: str, dataset: Dataset, scratch: Path, model: nn.Module, curves: TrainingLog) -> str:
        """The card, Markdown."""
        count = sum(parameter.numel() for parameter in model.parameters())
        return sor3d_card.text(name, dataset, kinds_of(scratch), dataclasses.asdict(self), count, curves)

    def to_json(self) -> str:
        """The job as text."""
        return json.dumps({"job": "afford.rgbd.train.sor3d_job:Sor3dJob", **dataclasses.asdict(self)})

    @classmethod
    def from_fields(cls, fields: dict[str, Any]) -> Sor3dJob:
        """The job again."""
        kinds: dict[str, type] = {"config": Sor3dConfig, "plan": Plan, "loss": LossParams, "changes": Changes}
        return cls(**{name: kinds[name](**_tuples(part)) if name in kinds else part for name, part in fields.items()})


def job(p: Any, recipe: Recipe | None, threads: int) -> Sor3dJob:
    """What the stage's parameters `p` say, where a recipe (its row, its seed) does not. ValueError for a width or a
    row that is not known."""
    if recipe is not None:
        p = replace(p, row=recipe.row, seed=recipe.seed)
    if p.variant not in VARIANTS or p.row not in ROWS:
        raise ValueError(f"model_train: expected variant of {', '.join(VARIANTS)} and row of {', '.join(ROWS)}, got {p.variant!r}, "
                         f"{p.row!r}")
    if p.variant == "small" and p.batch < 2:
        raise ValueError(f"model_train: expected a batch of 2 or more for small, which normalises over it, got {p.batch}")
    config = replace(VARIANTS[p.variant](), size_px=p.height_px)
    return Sor3dJob(
        config=row(config, p.row), plan=replace(plan_of(p, 1), betas=ADAM),
        loss=LossParams(turn=p.turn, dice=p.dice_weight, foreground=p.foreground_weight),
        changes=Changes(p.flip_share, p.crop_share, p.colour_share),
        batch=p.batch, static_share=p.static_share, coarse_share=p.coarse_share, balance=p.balance,
        val_samples=p.val_samples, vgg=p.backbones,
        seed=p.seed)  # fmt: skip


def spread(paths: list[Path], count: int) -> list[Path]:
    """At most `count` of them, spread over all."""
    count = min(count, len(paths))
    return [paths[round(n * (len(paths) - 1) / max(count - 1, 1))] for n in range(count)]


def kinds_of(scratch: Path) -> dict[str, Counter[str]]:
    """Sequences of both parts by '<object type> <affordance>'."""
    return {split: Counter(" ".join(sequences.kind(path)).strip() for path in paths) for split, paths in parts_of(scratch).items()}


def parts_of(scratch: Path) -> dict[str, list[Path]]:
    """The files of both parts, as `prepare` found them."""
    found = json.loads((scratch / FILES).read_text(encoding="utf-8"))
    return {split: [Path(path) for path in paths] for split, paths in found.items()}


def _own(model: nn.Module) -> Sor3d:
    assert isinstance(model, Sor3d)
    return model


def _tuples(fields: dict[str, Any]) -> dict[str, Any]:
    return {name: tuple(value) if isinstance(value, list) else value for name, value in fields.items()}
