"""Pre-train the first encoder of SOR3D-AFF's model on the classification of actions.

Reads   FileTree of action_pack or interaction_pack
Writes  Trained: files (model/encoder.safetensors, card.md, history.parquet, tensorboard/) and the TrainingLog
Method  the encoder with an LSTM and an action head, which is discarded; the loop of sor3d_train
Fails   when a split of the data set is empty, when validation has an action that training lacks, when the loss is not finite
Paper   SOR3D-AFF, pre-training on UTKinect-Action3D (`PAPER`: its rate, batch and epochs)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from afford.rgbd.train.params import InteractionTraining
from schemas.files import FileTree
from schemas.spec import Context
from schemas.training import Trained

if TYPE_CHECKING:
    from afford.rgbd.train.actions import ActionsJob

LIBRARIES = ("numpy", "torch", "safetensors", "opencv-python-headless", "pyarrow", "blake3", "protobuf")
THREADS = 2
MEMORY_GIB = 2.0
MACHINE = "bf16"  # a CPU without instructions for bfloat16 goes on in single precision
GPUS = ("device", "devices")


@dataclass(frozen=True)
class Params(InteractionTraining):
    """Parameters of `sor3d_pretrain`."""

    row: str = "rgbd_attention_flow3d"
    """model whose encoder is trained (sor3d_train); only rows without depth have another encoder"""
    steps: int = 300
    batch: int = 16
    lr: float = 3e-3
    bf16: bool = True
    validate_every: int = 150


PAPER = Params(variant="paper", height_px=300, steps=4000, batch=2, lr=2e-5, warmup=1, decay=False, weight_decay=0.0, clip_norm=0.0,
               bf16=False, validate_every=400, flip_share=0.0, crop_share=0.0, colour_share=0.0, device="cuda")  # fmt: skip
"""parameters of the paper: 50 epochs of 160 clips, the training split of UTKinect-Action3D after action_pack"""


def run(dataset: FileTree, params: Params, ctx: Context) -> Trained:
    """Train the encoder."""
    from afford.training.train import train_job

    return train_job(_job(params), dataset, "sor3d_actions", ctx, THREADS, params.devices)


def _job(p: Params) -> ActionsJob:
    from afford.rgbd.model.model_inputs import Augmentation
    from afford.rgbd.train.actions import ActionsJob
    from afford.rgbd.train.job import adam_plan, config_of

    return ActionsJob(
        config=config_of("sor3d_pretrain", p.variant, p.row, p.height_px, p.batch), plan=adam_plan(p),
        changes=Augmentation(p.flip_share, p.crop_share, p.colour_share), batch=p.batch, balance=p.balance,
        val_samples=p.val_samples, seed=p.seed)  # fmt: skip
