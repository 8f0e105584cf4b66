"""Parameters that every training by the shared loop has; a stage gives those another default that its model needs."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Optimisation:
    """Optimiser, schedule, validation and devices."""

    seed: int = 0
    """seed of weights, order and augmentation"""
    steps: int = 1000
    """steps of the optimiser, unless validation ends it earlier"""
    batch: int = 8
    """samples per micro-batch and device"""
    accumulate: int = 1
    """micro-batches per step"""
    lr: float = 1e-3
    """learning rate after the warm-up"""
    warmup: int = 20
    """steps of linear warm-up"""
    decay: bool = True
    """whether the learning rate falls linearly to 0 after the warm-up; false in the paper of SOR3D-AFF"""
    weight_decay: float = 0.01
    """of AdamW"""
    clip_norm: float = 1.0
    """largest norm of the gradient, 0 for any"""
    bf16: bool = False
    """mixed precision, where the device has instructions for it: GPUs, and CPUs with AMX or AVX512-BF16"""
    validate_every: int = 325
    """steps between two validations"""
    patience: int = 0
    """validations without a better one that end the training, 0 for never"""
    val_samples: int = 256
    """samples that judge, spread over all of them"""
    device: str = "cpu"
    """cpu or cuda"""
    devices: int = 1
    """processes that train together, each with a device of its own"""
