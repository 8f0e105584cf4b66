"""a data set of RGB-D interactions -> a detector of single pictures, with which SOR3D-AFF's model is compared.

Reads   FileTree that interaction_pack wrote
Writes  Trained: files (model/config.json, model/model.safetensors, card.md, history.parquet, tensorboard/, previews/) and the
        TrainingLog
Method  after AffordanceNet: boxes of things, and inside each box a mask of affordances, learned from the last frames; the loop of
        sor3d_train
Fails   when a part of the data set is empty, on a GPU, when the loss is not finite any more
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


@dataclass(frozen=True)
class Params(InteractionTraining):
    variant: str = "small"
    """widths of the encoder: small, or paper"""
    row: str = "rgbd"
    """what is seen of a picture: rows of sor3d_train with rgbd see depth, those with rgb see colours alone"""
    lr: float = 5e-4
    device: str = "cpu"
    """cpu; a GPU has no kernel that learns through samples inside of boxes and gives the same result twice"""


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
