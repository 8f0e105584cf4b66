"""Parameters of the training loop: those that a stage shows its users and the plan that the loop follows."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Optimisation:
    """Parameters that every stage over the shared loop has; a stage overrides the defaults that its model needs."""

    seed: int = 0
    """seed of weights, sampling and augmentation"""
    steps: int = 1000
    """steps of the optimizer; early stopping may end it sooner"""
    batch: int = 8
    """samples per micro-batch and device"""
    accumulate: int = 1
    """micro-batches per step"""
    lr: float = 1e-3
    """learning rate after the warm-up"""
    warmup: int = 20
    """steps of linear warm-up"""
    decay: bool = True
    """true: the learning rate falls linearly to 0 after the warm-up; false in the paper of SOR3D-AFF"""
    weight_decay: float = 0.01
    """of AdamW"""
    clip_norm: float = 1.0
    """largest norm of the gradient, 0 for no clipping"""
    bf16: bool = False
    """mixed precision on devices that have instructions for it: GPUs, and CPUs with AMX or AVX512-BF16"""
    validate_every: int = 325
    """steps between two validations"""
    patience: int = 0
    """early stopping: validations without a better one that end the training, 0 for never"""
    val_samples: int = 256
    """samples of validation, spread evenly over the split"""
    device: str = "cpu"
    """cpu or cuda"""
    devices: int = 1
    """data-parallel processes, each with a device of its own"""


@dataclass(frozen=True)
class Plan:
    """Optimizer, schedule, validation and threads of the loop. A step has `accumulate` x processes micro-batches."""

    steps: int
    lr: float = 3e-4
    betas: tuple[float, float] = (0.9, 0.95)
    weight_decay: float = 0.0
    clip_norm: float = 1.0
    warmup: int = 100
    decay: bool = True
    """true: the learning rate falls linearly to 0 after the warm-up"""
    accumulate: int = 1
    bf16: bool = False
    validate_every: int = 0
    """steps between two validations, 0 for none: then the last weights are kept"""
    patience: int = 0
    """early stopping: validations without a better one before training stops, 0 for never"""
    log_every: int = 10
    seed: int = 0
    device: str = "cpu"
    parallel: int = 1
    """micro-batches of a step that are computed in parallel: for models without dropout, in one process on a CPU"""
    workers: int = 1
    """threads that prefetch batches; the result does not depend on them"""

    def __post_init__(self) -> None:
        if min(self.steps, self.accumulate, self.log_every) < 1 or not 0 < self.warmup <= self.steps:
            raise ValueError(f"training: expected steps, accumulate, log_every >= 1 and 0 < warmup <= steps, got {self}")


def plan_of(p: Optimisation, parallel: int = 1) -> Plan:
    """Build the plan from the parameters of a stage."""
    return Plan(steps=p.steps, lr=p.lr, warmup=min(p.warmup, p.steps), decay=p.decay, weight_decay=p.weight_decay,
                clip_norm=p.clip_norm, accumulate=p.accumulate, bf16=p.bf16, validate_every=p.validate_every,
                patience=p.patience, seed=p.seed, device=p.device, parallel=parallel)  # fmt: skip
