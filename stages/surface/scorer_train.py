"""Train the embedded part scorer.

Reads   PartLessons of training and validation objects (their `split`: train or val)
Writes  Trained: files (config.json, model.safetensors, card.md, tensorboard/) and the TrainingLog
Method  a dual encoder: convolutions over crops of candidates, hashed subwords of phrases; cross-entropy of the share of a
        candidate that shows the part, and of their IoU. AdamW, linear warm-up and decay; the weights of the best validation are
        kept. The training loop is the common one: a killed training resumes to the same weights
Fails   when there are no training or no validation objects
Paper   replaces CLIP (ViT-L/14@336), AffordDex, negative affordance
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from schemas.spec import Context
from schemas.surface import PartLessons
from schemas.training import Trained

if TYPE_CHECKING:
    from afford.training.params import Plan

LIBRARIES = ("numpy", "torch", "safetensors", "opencv-python-headless", "protobuf", "blake3")
THREADS = 1
MEMORY_GIB = 2.0


@dataclass(frozen=True)
class Params:
    """Parameters of `scorer_train`."""

    steps: int = 2400
    """steps of the optimiser"""
    objects: int = 8
    """objects in a step"""
    candidates: int = 8
    """candidates of each object"""
    lr: float = 2e-3
    """learning rate after the warm-up; it decays linearly to 0"""
    warmup: int = 50
    """steps of linear warm-up"""
    weight_decay: float = 0.05
    """weight decay of AdamW"""
    validate_every: int = 500
    """steps between two validations"""
    seed: int = 0
    """seed of weights, order, phrases and views"""


def run(lessons: tuple[PartLessons, ...], params: Params, ctx: Context) -> Trained:
    """Train in the scratch folder, from which a killed training resumes."""
    from afford.common.files import tree
    from afford.surface.score import part_scorer
    from afford.surface.score import train_scorer as parts
    from afford.surface.score import train_scorer as parts_card
    from afford.surface.score.part_scorer import PartScorerConfig
    from afford.training import curves
    from afford.training.loop import derive_seed, deterministic, train

    with deterministic(THREADS, "cpu"):
        model = parts.init_scorer(PartScorerConfig(), derive_seed(params.seed))
        state = train(parts.scorer_task(model, lessons, params.seed, params.objects, params.candidates), _plan(params), ctx.scratch,
                      ctx.progress)
    root = part_scorer.save_scorer(ctx.scratch, model, parts_card.model_card(lessons, state))
    return Trained(tree("part-scorer", root), curves.training_log("part-scorer", state.points, state.best_step, state.step))


def _plan(p: Params) -> Plan:
    from afford.training.params import Plan

    return Plan(steps=p.steps, lr=p.lr, warmup=min(p.warmup, p.steps), weight_decay=p.weight_decay, seed=p.seed,
                validate_every=min(p.validate_every, p.steps))  # fmt: skip
