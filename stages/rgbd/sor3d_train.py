"""Train SOR3D-AFF's model: affordances of the last frame and the action, from RGB-D interactions.

Reads   FileTree of interaction_pack; a Recipe, for a row of the ablation; the files of a pre-training (sor3d_pretrain), if any;
        the VGG16 checkpoint named by `backbones`, if any
Writes  Trained: files (model/config.json, model/model.safetensors, card.md, history.parquet, tensorboard/, previews/) and the
        TrainingLog
Method  Adam, linear warm-up and decay; sampling, augmentation and random states are functions of the seed and the step, so that a
        killed training resumes to the same weights; the weights of the best validation are kept; several devices by
        torch.distributed.run
Fails   when a split of the data set is empty, when variant or row is unknown, when the loss is not finite
Paper   SOR3D-AFF, training (`PAPER`: its rate, batch and epochs)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from afford.rgbd.train.params import InteractionTraining
from schemas.files import FileTree
from schemas.spec import Context
from schemas.training import Recipe, Trained

if TYPE_CHECKING:
    from afford.rgbd.train.sor3d import Sor3dJob

LIBRARIES = ("numpy", "torch", "safetensors", "opencv-python-headless", "pyarrow", "blake3", "protobuf")
THREADS = 2
MEMORY_GIB = 2.0
SCRATCH_GIB = 1.0
MACHINE = "bf16"  # a CPU without instructions for bfloat16 goes on in single precision
GPUS = ("device", "devices")


@dataclass(frozen=True)
class Params(InteractionTraining):
    """Parameters of `sor3d_train`."""

    static_share: float = 0.5
    """share of a batch whose last frames are added as pictures; 0 in the paper"""
    foreground_weight: float = 3.0
    """weight of pixels with an affordance, relative to background; 1 in the paper"""
    turn: float = 0.5
    """share of the steps after which regions count as much as the action (before: a quarter of it); 0.75 in the paper"""
    dice_weight: float = 2.0
    """weight of the Dice loss; 0 in the paper"""
    coarse_share: float = 0.45
    """share of the first steps, at half the size"""
    backbones: str = ""
    """a VGG16 checkpoint for the stream of motion: a file, or a hub id"""
    steps: int = 1300
    batch: int = 16
    lr: float = 3e-3
    bf16: bool = True


PAPER = Params(variant="paper", height_px=300, steps=96200, batch=2, lr=2e-5, warmup=1, decay=False, weight_decay=0.0,
               clip_norm=0.0, bf16=False, validate_every=4810, static_share=0.0, coarse_share=0.0, foreground_weight=1.0,
               turn=0.75, dice_weight=0.0, flip_share=0.0, crop_share=0.0, colour_share=0.0, device="cuda")  # fmt: skip
"""parameters of the paper: 200 epochs of 962 sequences"""


def run(dataset: FileTree, params: Params, ctx: Context, recipe: Recipe | None = None, encoder: FileTree | None = None,
        weights: FileTree | None = None) -> Trained:  # fmt: skip
    """Train the model, from the `encoder` of a pre-training if there is one."""
    from afford.models.weights import with_local_weights
    from afford.training.train import train_job

    job = _job(with_local_weights(params, weights, "backbones"), recipe)
    if encoder is not None:
        job = job.starting_from(encoder)
    return train_job(job, dataset, recipe.name if recipe else "sor3d", ctx, THREADS, params.devices)


def _job(p: Params, recipe: Recipe | None = None) -> Sor3dJob:
    """Job of the parameters; a recipe overrides row and seed."""
    from afford.rgbd.model.losses import LossParams
    from afford.rgbd.model.model_inputs import Augmentation
    from afford.rgbd.train.job import adam_plan, config_of
    from afford.rgbd.train.sor3d import Sor3dJob

    if recipe is not None:
        p = replace(p, row=recipe.row, seed=recipe.seed)
    return Sor3dJob(
        config=config_of("sor3d_train", p.variant, p.row, p.height_px, p.batch), plan=adam_plan(p),
        loss=LossParams(turn=p.turn, dice=p.dice_weight, foreground=p.foreground_weight),
        changes=Augmentation(p.flip_share, p.crop_share, p.colour_share), batch=p.batch, static_share=p.static_share,
        coarse_share=p.coarse_share, balance=p.balance, val_samples=p.val_samples, vgg=p.backbones, seed=p.seed)  # fmt: skip
