"""Everything that decides a training of a two-hand model."""

from __future__ import annotations

import dataclasses
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from torch import nn

from afford.dataset.load import Item
from afford.training.job import Dataset
from afford.training.params import Plan
from afford.training.sampler import BalancedSampler
from afford.training.state import TrainingState
from afford.twohands.model import files, known
from afford.twohands.model.build import build
from afford.twohands.model.config import ModelConfig
from afford.twohands.model.losses import LossParams
from afford.twohands.model.model import TwoHands
from afford.twohands.train import cache, card, divide
from afford.twohands.train.batches import Batches, Boxes
from afford.twohands.train.divide import Division
from afford.twohands.train.hands import Hands, judged_batches
from afford.twohands.train.views import Seen, Views, cropped, whole
from schemas.training import TrainingLog


@dataclass(frozen=True)
class HandsJob:
    """A model, what it learns from, and how (`afford.training.job.Job`)."""

    config: ModelConfig
    plan: Plan
    loss: LossParams
    division: Division
    views: Views
    batch: int
    """samples per micro-batch and process"""
    coarse_share: float
    """share of the steps that come first, at half the size"""
    balance: float
    """0: samples as they are; 1: every verb with its taxonomy as often as any other"""
    val_samples: int
    """samples that judge, spread over all of them; every second one is cropped to its objects"""
    zoom: float
    """samples are kept at this many times the size of the model, so that crops stay sharp"""
    target: str
    """affordance or object"""
    seed: int

    def prepare(self, data: Mapping[str, Path], scratch: Path) -> None:
        """Decode the samples of both parts once. ValueError when one of them has none."""
        largest = tuple(round(side * self.zoom) for side in self.config.size_px)
        for name in ("train", "val"):
            cache.write(divide.part(data, self.division, name), scratch / name, (largest[0], largest[1]))
            if not len(cache.Cache(scratch / name)):
                raise ValueError(f"data set: expected samples in the part {name}, found none; choose another split_by or "
                                 "val_fraction")

    def task(self, scratch: Path, processes: int) -> Hands:
        """A new model, the batches of training and those of validation."""
        learned, boxes = cache.Cache(scratch / "train"), Boxes(self.config.size_px)
        order = BalancedSampler([(row["verb"], row["taxonomy"]) for row in learned.rows], self.balance, self.seed)
        coarse = round(self.coarse_share * self.plan.steps) * self.plan.accumulate * processes
        batches = Batches(learned, order, self.views, boxes, self.batch, self.seed, coarse)
        judged = judged_batches(self.judges(cache.Cache(scratch / "val")), boxes, self.batch)
        return Hands(build(self.config, self.seed), batches, judged, self.loss, self.target, self.plan.device)

    def judges(self, samples: Sequence[Item]) -> list[Seen]:
        """Samples spread over all of them, every second one cropped to its objects."""
        count = min(self.val_samples, len(samples))
        chosen = [samples[round(n * (len(samples) - 1) / max(count - 1, 1))] for n in range(count)]
        return [cropped(item, self.views) if n % 2 else whole(item) for n, item in enumerate(chosen)]

    def finish(self, model: nn.Module, state: TrainingState) -> None:
        """The threshold that was best for the weights that were kept."""
        found = {point.name: point.value for point in state.points if point.step == state.best_step}
        if "val.threshold" in found:
            _own(model).config = replace(self.config, threshold=found["val.threshold"])

    def save(self, model: nn.Module, folder: Path, scratch: Path) -> None:
        """config.json, model.safetensors, what comes with backbones, and words.json: the vocabulary of the part that teaches."""
        files.save(_own(model), folder)
        known.write(known.of((row["narration"], row["verb"], row["noun"]) for row in cache.Cache(scratch / "train").rows), folder)

    def card(self, name: str, dataset: Dataset, scratch: Path, model: nn.Module, curves: TrainingLog) -> str:
        """The card, Markdown."""
        source = card.Source(dataset.name, dataset.digest, dataset.licence, about(scratch))
        count = sum(parameter.numel() for parameter in model.parameters())
        return card.text(name, source, dataclasses.asdict(self), _own(model).config.threshold, count, curves)

    def to_json(self) -> str:
        """The job as text."""
        return json.dumps({"job": "afford.twohands.train.hands_job:HandsJob", **dataclasses.asdict(self)})

    @classmethod
    def from_fields(cls, fields: dict[str, Any]) -> HandsJob:
        """The job again."""
        kinds: dict[str, type] = {"config": ModelConfig, "plan": Plan, "loss": LossParams, "division": Division,
                                  "views": Views}
        return cls(**{name: kinds[name](**_tuples(part)) if name in kinds else part for name, part in fields.items()})


def about(scratch: Path) -> dict[str, dict[str, Any]]:
    """What the two parts hold: samples, videos, verbs, nouns, taxonomy."""
    return {name: _about(cache.Cache(scratch / name).rows) for name in ("train", "val")}


def _about(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    sets = {name: len({row[name] for row in rows}) for name in ("video", "verb", "noun")}
    return {"samples": len(rows), **sets, "taxonomy": dict(sorted(Counter(row["taxonomy"] for row in rows).items()))}


def _own(model: nn.Module) -> TwoHands:
    assert isinstance(model, TwoHands)
    return model


def _tuples(fields: dict[str, Any]) -> dict[str, Any]:
    return {name: tuple(value) if isinstance(value, list) else value for name, value in fields.items()}
