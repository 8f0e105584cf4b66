"""Everything that decides a training of a two-hand model, as plain data that travels to the processes that do it."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from typing import Any

from afford.models.twohands.config import ModelConfig
from afford.models.twohands.losses import LossParams
from afford.training.divide import Division
from afford.training.task import Plan
from afford.training.views import Views


@dataclass(frozen=True)
class Job:
    """A model, what it learns from, and how."""

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

    def to_json(self) -> str:
        """The job as text."""
        return json.dumps(dataclasses.asdict(self))

    @classmethod
    def from_json(cls, text: str) -> Job:
        """The job again."""
        parts: dict[str, Any] = json.loads(text)
        kinds: dict[str, type] = {"config": ModelConfig, "plan": Plan, "loss": LossParams, "division": Division,
                                  "views": Views}
        return cls(**{name: kinds[name](**_tuples(part)) if name in kinds else part for name, part in parts.items()})


def _tuples(fields: dict[str, Any]) -> dict[str, Any]:
    return {name: tuple(value) if isinstance(value, list) else value for name, value in fields.items()}
