"""Evaluation of a trained model on sequences, as videos and as single pictures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from afford.dataset import packed_sequences
from afford.dataset.packed_sequences import PackedSequence
from afford.rgbd.evaluate.metrics import code_f1, code_jaccard, counts
from afford.rgbd.model.model import Sor3d, predict_with_flip
from afford.rgbd.model.model_inputs import fit_to_model, last_frame, stack
from schemas.interaction import BACKGROUND, InteractionScores, ShownAnswer

MODES = ("video", "static")


class SequenceAnswer(NamedTuple):
    """Prediction of one sequence, as arrays for metrics and reports."""

    label: np.ndarray
    """(h, w) uint8"""
    probability: np.ndarray
    """(10, h, w) float32 of every affordance, the background last"""
    confidence: np.ndarray
    """(h, w) float16 probability of the label"""
    action: np.ndarray
    """(9,) float32 probabilities"""
    attention: np.ndarray
    """(a, b) float32 over the latent, (0, 0) for none"""


def evaluate_model(name: str, model: Sor3d, paths: Sequence[Path], shown: int, device: str, progress: Callable[[int, int], None],
            mirror: bool = False) -> InteractionScores:  # fmt: skip
    """Score every sequence, one at a time, so that sequences may have any length.

    With `mirror` predictions are averaged with those of the mirror image. `shown` answers, spread over the set, are kept for a
    sheet.
    """
    kept = spread_indices(len(paths), shown)
    rows, pixels, regions, codes, pictures = [], [], [], [], []
    for n, path in enumerate(paths):
        one = fit_to_model(packed_sequences.read_sequence(path, model.config.flow), model.config.size_px)
        answers = predict_last_frame(model, one, device, mirror), predict_last_frame(model, last_frame(one), device, mirror)
        found = [counts(answer.label, one.label) for answer in answers]
        pixels.append([[of.hit, of.found, of.true] for of in found])
        regions.append([region_overlap(answer.label, one.label) for answer in answers])
        codes.append([released_metrics(answer, one.label) for answer in answers])
        pictures += [_shown(one, answers)] if n in kept else []
        rows.append((one.name, one.object_type, one.affordance, [answer.action for answer in answers]))
        progress(n + 1, len(paths))
    names, types, affordances, actions = zip(*rows, strict=True)
    return InteractionScores(name, MODES, names, types, affordances, np.array(pixels, np.int64), np.array(regions, np.int64),
                             np.array(codes, np.float64), np.array(actions, np.float32), tuple(pictures))  # fmt: skip


def predict_last_frame(model: Sor3d, one: PackedSequence, device: str = "cpu", mirror: bool = False) -> SequenceAnswer:
    """Predict the last frame of a sequence that has the size of the model."""
    with torch.inference_mode():
        seen = stack([[one]], model.config).groups[0].to(device)
        output = predict_with_flip(model, seen) if mirror else model(seen)
        probability = output.logits[0].softmax(0)
        confidence, label = probability.max(0)
        attention = torch.zeros(0, 0) if output.attention is None else output.attention[0, 0]
    return SequenceAnswer(label.cpu().numpy().astype(np.uint8), probability.cpu().numpy(),
                          confidence.cpu().numpy().astype(np.float16), output.action[0].softmax(0).cpu().numpy(),
                          attention.cpu().numpy())  # fmt: skip


def released_metrics(answer: SequenceAnswer, truth: np.ndarray) -> tuple[float, float]:
    """Jaccard and F1 as the released code computes them."""
    return code_jaccard(answer.label, truth), code_f1(answer.probability, truth)


def region_overlap(found: np.ndarray, truth: np.ndarray) -> int:
    """Number of pixels that have any affordance in both labels."""
    return int(np.count_nonzero((found != BACKGROUND) & (truth != BACKGROUND)))


def spread_indices(of: int, count: int) -> set[int]:
    """Indices spread evenly over `of`, at most `count`."""
    count = min(of, count)
    return {round(n * (of - 1) / max(count - 1, 1)) for n in range(count)}


def _shown(one: PackedSequence, answers: Sequence[SequenceAnswer]) -> ShownAnswer:
    parts = (np.stack([getattr(answer, name) for answer in answers]) for name in ("label", "confidence", "attention"))
    return ShownAnswer(one.name, one.rgb[-1].copy(), one.label.copy(), *parts)
