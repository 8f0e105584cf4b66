"""Train the hand finder, which finds hands, their sides, touched objects and sleeves in pictures, on rendered rooms.

Reads   HandLessons of training and of validation rooms (their `split`: train or val)
Writes  Trained: files (config.json, model.safetensors, card.md, previews/, tensorboard/) and the TrainingLog
Method  a small U-Net with batch normalisation. Every picture is augmented: rotation, crop, mirror, background, skin-coloured
        distractors, light, blur, noise, JPEG. Cross-entropy and Dice losses. AdamW, linear warm-up and decay; the weights of the
        best validation are kept. A killed training resumes to the same weights
Fails   when a split lacks pictures with hands, or pictures without
Paper   replaces annotated hands (VISOR) for video without masks; no paper
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from schemas.scene import HandLessons
from schemas.spec import Context
from schemas.training import Trained

if TYPE_CHECKING:
    from afford.training.params import Plan

LIBRARIES = ("numpy", "torch", "safetensors", "opencv-python-headless", "protobuf", "blake3")
THREADS = 1
MEMORY_GIB = 1.5


@dataclass(frozen=True)
class Params:
    """Parameters of `hands_train`."""

    steps: int = 4000
    """steps of the optimiser"""
    batch: int = 16
    """pictures in a step"""
    width_px: int = 160
    """width of a crop"""
    height_px: int = 96
    """height of a crop"""
    lr: float = 3e-3
    """learning rate after the warm-up; it decays linearly to 0"""
    warmup: int = 50
    """steps of linear warm-up"""
    weight_decay: float = 0.02
    """weight decay of AdamW"""
    validate_every: int = 1000
    """steps between two validations"""
    judged: int = 96
    """augmented pictures of the validation rooms per validation"""
    seed: int = 0
    """seed of weights, order and augmentation"""


def run(lessons: tuple[HandLessons, ...], params: Params, ctx: Context) -> Trained:
    """Train in the scratch folder; a killed training resumes there."""
    from afford.common.files import tree
    from afford.extraction.hands import network
    from afford.extraction.hands import train as finder
    from afford.extraction.hands.network import HandFinderConfig
    from afford.training import curves
    from afford.training.loop import derive_seed, deterministic, train

    with deterministic(THREADS, "cpu"):
        model = finder.init_model(HandFinderConfig(), derive_seed(params.seed))
        task = finder.make_task(model, lessons, params.seed, params.batch, (params.height_px, params.width_px), params.judged)
        state = train(task, _plan(params), ctx.scratch, ctx.progress)
    root = network.write_network(ctx.scratch, model, finder.card_text(lessons, state))
    return Trained(tree("hands-finder", root), curves.training_log("hands-finder", state.points, state.best_step, state.step))


def _plan(p: Params) -> Plan:
    from afford.training.params import Plan

    return Plan(steps=p.steps, lr=p.lr, warmup=min(p.warmup, p.steps), weight_decay=p.weight_decay, seed=p.seed,
                validate_every=min(p.validate_every, p.steps))  # fmt: skip
