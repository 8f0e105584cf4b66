"""A trained model on sequences, as videos and as pictures."""

from __future__ import annotations

from collections.abc import Callable
from collections.abc import Sequence as Listed
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from afford.dataset import packed_sequences
from afford.dataset.packed_sequences import PackedSequence
from afford.rgbd.evaluate.metrics import code_f1, code_jaccard, counts
from afford.rgbd.model.both_ways import both_ways
from afford.rgbd.model.model import Sor3d
from afford.rgbd.model.sequence_batches import fitted, last, stack
from schemas.interaction import BACKGROUND, InteractionScores, ShownAnswer

MODES = ("video", "static")


class Answer(NamedTuple):
    """What a model says of one sequence."""

    label: np.ndarray
    """(h, w) uint8"""
    probability: np.ndarray
    """(10, h, w) float32 of every affordance, the background last"""
    confidence: np.ndarray
    """(h, w) float16"""
    action: np.ndarray
    """(9,) float32 probabilities"""
    attention: np.ndarray
    """(a, b) float32 over the latent, (0, 0) for none"""


def examine(name: str, model: Sor3d, paths: Listed[Path], shown: int, device: str, progress: Callable[[int, int], None],
            mirror: bool = False) -> InteractionScores:  # fmt: skip
    """Every sequence, one at a time, so that they may have any lengths; with `mirror` its mirror image too."""
    kept = spread(len(paths), shown)
    rows, pixels, regions, codes, pictures = [], [], [], [], []
    for n, path in enumerate(paths):
        one = fitted(packed_sequences.read_sequence(path, model.config.flow), model.config.size_px)
        said = ask(model, one, device, mirror), ask(model, last(one), device, mirror)
        found = [counts(answer.label, one.label) for answer in said]
        pixels.append([[of.hit, of.found, of.true] for of in found])
        regions.append([in_both(answer.label, one.label) for answer in said])
        codes.append([as_released(answer, one.label) for answer in said])
        pictures += [_shown(one, said)] if n in kept else []
        rows.append((one.name, one.object_type, one.affordance, [answer.action for answer in said]))
        progress(n + 1, len(paths))
    names, types, affordances, actions = zip(*rows, strict=True)
    return InteractionScores(name, MODES, names, types, affordances, np.array(pixels, np.int64), np.array(regions, np.int64),
                             np.array(codes, np.float64), np.array(actions, np.float32), tuple(pictures))  # fmt: skip


def ask(model: Sor3d, one: PackedSequence, device: str = "cpu", mirror: bool = False) -> Answer:
    """About the last frame of a sequence, at the size of the model."""
    with torch.inference_mode():
        seen = stack([[one]], model.config).groups[0].to(device)
        said = both_ways(model, seen) if mirror else model(seen)
        probability = said.logits[0].softmax(0)
        confidence, label = probability.max(0)
        attention = torch.zeros(0, 0) if said.attention is None else said.attention[0, 0]
    return Answer(label.cpu().numpy().astype(np.uint8), probability.cpu().numpy(), confidence.cpu().numpy().astype(np.float16),
                  said.action[0].softmax(0).cpu().numpy(), attention.cpu().numpy())


def as_released(answer: Answer, truth: np.ndarray) -> tuple[float, float]:
    """Jaccard and F1 as the released code computes them."""
    return code_jaccard(answer.label, truth), code_f1(answer.probability, truth)


def in_both(found: np.ndarray, truth: np.ndarray) -> int:
    """Pixels that have an affordance in both labels, be it the same or not."""
    return int(np.count_nonzero((found != BACKGROUND) & (truth != BACKGROUND)))


def spread(of: int, count: int) -> set[int]:
    """At most `count` positions, spread over `of`."""
    count = min(of, count)
    return {round(n * (of - 1) / max(count - 1, 1)) for n in range(count)}


def _shown(one: PackedSequence, said: Listed[Answer]) -> ShownAnswer:
    parts = (np.stack([getattr(answer, name) for answer in said]) for name in ("label", "confidence", "attention"))
    return ShownAnswer(one.name, one.rgb[-1].copy(), one.label.copy(), *parts)
