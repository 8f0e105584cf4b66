"""Train the network that segments what a hand holds, in crops around hands, on rendered rooms.

Reads   HandLessons of training and of validation rooms (their `split`: train or val); MediaPipe's palm detector; photographs
        without hands, where there are any
Writes  Trained: files (config.json, model.safetensors, card.md, previews/, tensorboard/) and the TrainingLog
Method  crops around one hand, with its mask and that of the other hand, disturbed as detection errs; a decoder on the frozen
        feature maps of the palm detector, which was trained on real hands, and on an encoder of the masks that is trained too.
        Outputs: held object, sleeve, touch. Backgrounds, skin, light, blur, noise and JPEG are augmented. Cross-entropy and Dice
        losses, AdamW, linear warm-up and decay; the weights of the best validation are kept, without those of the frozen encoder.
        A killed training resumes to the same weights
Fails   when a split lacks pictures with hands, or pictures without; when a photograph is not readable
Paper   replaces annotated objects (VISOR) for video without masks; no paper
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.scene import HandLessons
from schemas.spec import Context
from schemas.training import Trained

LIBRARIES = ("numpy", "torch", "safetensors", "opencv-python-headless", "protobuf", "blake3")
THREADS = 1
MEMORY_GIB = 1.5


@dataclass(frozen=True)
class Params:
    """Parameters of `held_train`."""

    steps: int = 3000
    """steps of the optimiser"""
    batch: int = 16
    """crops in a step"""
    size_px: int = 128
    """height and width of a crop"""
    lr: float = 3e-3
    """learning rate after the warm-up; it decays linearly to 0"""
    warmup: int = 50
    """steps of linear warm-up"""
    weight_decay: float = 0.02
    """weight decay of AdamW"""
    validate_every: int = 500
    """steps between two validations"""
    judged: int = 192
    """crops of the validation rooms per validation"""
    photographs: str = ""
    """folder of photographs without hands, which become backgrounds"""
    seed: int = 0
    """seed of weights, order and augmentation"""


def run(lessons: tuple[HandLessons, ...], networks: FileTree, params: Params, ctx: Context,
        photographs: FileTree | None = None) -> Trained:  # fmt: skip
    """Train in the scratch folder; a killed training resumes there.

    networks: MediaPipe's networks. photographs: pictures without hands.
    """
    from afford.common.files import tree
    from afford.common.photographs import read_photographs
    from afford.extraction.hands import held_network
    from afford.extraction.hands import held_train as held
    from afford.extraction.hands.held_model import HeldConfig
    from afford.training import curves
    from afford.training.loop import derive_seed, deterministic, train
    from afford.training.params import Plan

    shown = read_photographs(photographs) if photographs else ()
    plan = Plan(steps=params.steps, lr=params.lr, warmup=min(params.warmup, params.steps), weight_decay=params.weight_decay,
                seed=params.seed, validate_every=min(params.validate_every, params.steps))  # fmt: skip
    with deterministic(THREADS, "cpu"):
        model = held.init_model(HeldConfig(params.size_px), derive_seed(params.seed), held_network.palm_detector(networks))
        task = held.HeldTask(model, lessons, params.seed, params.batch, params.judged, shown)
        state = train(task, plan, ctx.scratch, ctx.progress)
    root = held_network.write_network(ctx.scratch, model, held.card_text(lessons, state, len(shown)))
    return Trained(tree("held-objects", root), curves.training_log("held-objects", state.points, state.best_step, state.step))
