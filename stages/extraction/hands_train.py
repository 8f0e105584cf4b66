"""lessons of many rooms -> the finder of hands: where they are in a picture, which they are, and what they touch.

Reads   HandLessons of rooms to learn from and of rooms that judge (their `split`: train or val)
Writes  Trained: files (config.json, model.safetensors, card.md, previews/, tensorboard/) and the TrainingLog
Method  a small fully convolutional network with skips, normalised over the batch. Every lesson comes in a new disguise: turned,
        cut out, mirrored, before other surroundings, among things of the colour of skin, in other light, soft, noisy,
        compressed. Cross-entropy and overlap. AdamW, linear warm-up and decay; the weights of the best validation are kept.
        The loop of all trainings: killed, it goes on to the same weights
Fails   when a split has no pictures with hands, or none without
Paper   takes the place of annotated hands (VISOR) where a video has none; no paper
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
MEMORY_GIB = 3.0


@dataclass(frozen=True)
class Params:
    steps: int = 4000
    """steps of the optimiser"""
    batch: int = 16
    """pictures in a step"""
    width_px: int = 160
    """width of what is cut out of a lesson"""
    height_px: int = 96
    """height of what is cut out of a lesson"""
    lr: float = 3e-3
    """learning rate after the warm-up; it falls linearly to 0"""
    warmup: int = 50
    """steps of linear warm-up"""
    weight_decay: float = 0.02
    """of AdamW"""
    validate_every: int = 1000
    """steps between two validations"""
    judged: int = 96
    """disguised pictures of the validation rooms that judge"""
    seed: int = 0
    """seed of weights, order and disguises"""


def run(lessons: tuple[HandLessons, ...], params: Params, ctx: Context) -> Trained:
    """Train in the scratch folder, where a killed training goes on."""
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
