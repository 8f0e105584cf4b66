"""Train the hand finder, which finds hands, their sides, touched objects and sleeves in pictures, on rendered rooms.

Reads   HandLessons of training and of validation rooms (their `split`: train or val); MediaPipe's palm detector and photographs
        without hands, where there are any
Writes  Trained: files (config.json, model.safetensors, calibration.json, card.md, previews/, tensorboard/) and the TrainingLog
Method  a decoder on the frozen feature maps of the palm detector, which was trained on real hands, or, without its file, on an
        encoder that is trained too. Every picture is augmented: rotation, crop, mirror, background (rooms, surfaces, photographs),
        skin, faces and other distractors, light, blur, noise, JPEG. Cross-entropy and Dice losses. AdamW, linear warm-up and decay;
        the weights of the best validation are kept, and their log odds are calibrated on materials that the training lacks. A
        killed training resumes to the same weights
Fails   when a split lacks pictures with hands, or pictures without; when a photograph is not readable
Paper   replaces annotated hands (VISOR) for video without masks; no paper
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from schemas.files import FileTree
from schemas.scene import HandLessons
from schemas.spec import Context
from schemas.training import Trained

if TYPE_CHECKING:
    from pathlib import Path

    from afford.training.params import Plan

LIBRARIES = ("numpy", "torch", "safetensors", "opencv-python-headless", "protobuf", "blake3")
THREADS = 1
MEMORY_GIB = 1.5


@dataclass(frozen=True)
class Params:
    """Parameters of `hands_train`."""

    steps: int = 3000
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
    photographs: str = ""
    """folder of photographs without hands, which become backgrounds"""
    seed: int = 0
    """seed of weights, order and augmentation"""


def run(lessons: tuple[HandLessons, ...], params: Params, ctx: Context, landmarks: FileTree | None = None,
        photographs: FileTree | None = None) -> Trained:  # fmt: skip
    """Train in the scratch folder; a killed training resumes there.

    landmarks: files of MediaPipe's palm detector and landmark network. photographs: pictures without hands.
    """
    from afford.common.files import tree
    from afford.common.photographs import read_photographs
    from afford.extraction.hands import network
    from afford.extraction.hands import train as finder
    from afford.extraction.hands.model import HandFinderConfig
    from afford.training import curves
    from afford.training.loop import derive_seed, deterministic, train

    size, shown = (params.height_px, params.width_px), read_photographs(photographs) if photographs else ()
    with deterministic(THREADS, "cpu"):
        model = finder.init_model(HandFinderConfig(), derive_seed(params.seed), _palm(landmarks))
        task = finder.make_task(model, lessons, params.seed, params.batch, size, params.judged, shown)
        state = train(task, _plan(params), ctx.scratch, ctx.progress)
        calibration = task.calibrated()
    root = network.write_network(ctx.scratch, model, finder.card_text(lessons, state, model.kind, len(shown)), calibration)
    return Trained(tree("hands-finder", root), curves.training_log("hands-finder", state.points, state.best_step, state.step))


def _palm(landmarks: FileTree | None) -> Path | None:
    """Path of the palm detector."""
    from afford.extraction.landmarks.files import PALM

    found = landmarks.find(PALM) if landmarks else None
    return found.path if found else None


def _plan(p: Params) -> Plan:
    from afford.training.params import Plan

    return Plan(steps=p.steps, lr=p.lr, warmup=min(p.warmup, p.steps), weight_decay=p.weight_decay, seed=p.seed,
                validate_every=min(p.validate_every, p.steps))  # fmt: skip
