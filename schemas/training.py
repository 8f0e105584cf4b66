"""Trainings: ablation recipes, curves over steps, and the trained model with its log."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from schemas.files import FileTree
from schemas.spec import Bundle, Schema, array, value

if TYPE_CHECKING:
    import numpy as np


@dataclass(frozen=True)
class Recipe(Schema):
    """One row of an ablation: the parameters that differ from those of the stage."""

    name: str = value("label, unique among its siblings: <row>-<seed>")
    row: str = value("row of the table, shared by its seeds")
    variant: str = value("small, clip or vlm")
    hypotheses: int = value("regions per hand, 1 is the paper's model")
    text: bool = value("whether the model is prompted with the task")
    decoders: int = value("2, or 1: one region for whichever hand, as LISA has it")
    target: str = value("affordance, or object: the complete object of each hand")
    seed: int = value("seed of weights, order and augmentation")
    data: str = value("what it learns from: stills, with exact labels, or extracted, labels taken from rendered videos")
    pretrained: bool = value("whether the backbones of clip and vlm were trained before; without, they are tiny and random")
    taxonomy: bool = value("whether it learns which hands act")
    steps: int = value("most steps of its training, 0 for as many as the other rows")
    sizes: str = value("variant whose input size and schedule of validations it has; '' for those of the stage", default="")


@dataclass(frozen=True)
class Curve(Schema):
    """One scalar over the steps of a training."""

    name: str = value("dotted: train.total, train.lr, val.iou")
    step: np.ndarray = array("n", "int64", "steps done when it was measured, ascending")
    value: np.ndarray = array("n", "float64", "what was measured")


@dataclass(frozen=True)
class TrainingLog(Schema):
    """Log of a training: its curves."""

    name: str = value("what was trained")
    curves: tuple[Curve, ...] = value("by name")
    best_step: int = value("step whose weights were kept")
    steps: int = value("steps done, fewer than requested after an early stop")


@dataclass(frozen=True)
class Trained(Bundle):
    """Trained model and its log; each field is an artifact of its own."""

    files: FileTree = value("model/, card.md, history.parquet, tensorboard/, previews/")
    log: TrainingLog = value("its curves")
