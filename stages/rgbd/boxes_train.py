"""Train the box detector of single pictures that SOR3D-AFF's model is compared with.

Reads   FileTree of interaction_pack
Writes  Trained: files (model/config.json, model/model.safetensors, card.md, history.parquet, tensorboard/, previews/) and the
        TrainingLog
Method  after AffordanceNet: boxes of objects, and in each box a mask of affordances, learned from last frames; the loop of
        sor3d_train
Fails   when a split of the data set is empty, on a GPU, when the loss is not finite
Paper   AffordanceNet (Do, Nguyen and Reid 2018), small; SOR3D-AFF compares with it
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from afford.rgbd.train.params import InteractionTraining
from schemas.files import FileTree
from schemas.spec import Context
from schemas.training import Trained

if TYPE_CHECKING:
    from afford.rgbd.train.boxes import BoxesJob

LIBRARIES = ("numpy", "torch", "safetensors", "opencv-python-headless", "pyarrow", "blake3", "protobuf")
THREADS = 2
MEMORY_GIB = 2.0
MACHINE = "bf16"  # a CPU without instructions for bfloat16 goes on in single precision
GPUS = ("device", "devices")


@dataclass(frozen=True)
class Params(InteractionTraining):
    """Parameters of `boxes_train`."""

    variant: str = "small"
    """widths of the encoder: small, or paper"""
    row: str = "rgbd"
    """input: rows of sor3d_train with rgbd have depth, those with rgb have colours only"""
    lr: float = 5e-4
    device: str = "cpu"
    """cpu; no GPU kernel of the backward pass through RoIAlign is deterministic"""


def run(dataset: FileTree, params: Params, ctx: Context) -> Trained:
    """Train the detector."""
    from afford.training.train import train_job

    return train_job(_job(params), dataset, "boxes", ctx, THREADS, params.devices)


def _job(p: Params) -> BoxesJob:
    from afford.rgbd.model.model_inputs import Augmentation
    from afford.rgbd.train.boxes import BoxesJob
    from afford.rgbd.train.job import adam_plan, config_of

    if p.device != "cpu":
        raise ValueError(f"boxes_train: expected device=cpu for the detector, got {p.device!r}; it takes minutes")
    config = config_of("boxes_train", p.variant, p.row, p.height_px, p.batch)
    return BoxesJob(
        config=replace(config, flow="none", attention=False), plan=adam_plan(p),
        changes=Augmentation(p.flip_share, p.crop_share, p.colour_share), batch=p.batch, balance=p.balance,
        val_samples=p.val_samples, seed=p.seed)  # fmt: skip
