"""The most likely sequence of touched objects of a hand, and of times without a touch, over the segmented frames: Viterbi."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from afford.common.masks import iou
from afford.extraction.hands.motion import SampledFrames
from afford.extraction.hands.touch_candidates import Candidates
from afford.extraction.hands.touch_ranker import touch_scores

BEST = 6
"""candidates of a frame that take part, by score"""
MOST = 4.0
"""largest score of a candidate"""


@dataclass(frozen=True)
class PathModel:
    """Costs of a sequence, in log odds."""

    touch: float
    """added to the score of every candidate; 0 for even odds that a hand with an even candidate touches it"""
    same: float
    """weight of the overlap with the object of the frame before"""
    change: float
    """cost of another object, of a touch that begins and of one that ends"""
    unsure: float
    """a hand without a touch is unsure from this score on"""


@dataclass(frozen=True, eq=False)
class TouchPath:
    """Touched objects of one hand in the segmented frames of a run in which it is visible."""

    masks: dict[int, np.ndarray | None]
    """sampled frame -> object (h, w) bool, None without a touch"""
    unsure: tuple[int, ...]
    """sampled frames without a touch in which one is nearly as likely"""


def touch_path(found: Mapping[int, Candidates], sampled: SampledFrames, model: PathModel) -> TouchPath:
    """Choose the object that a hand touches in every segmented frame; `found` has the frames of one run, ascending."""
    frames = list(found)
    scores = [np.minimum(touch_scores(found[k].features), MOST) + model.touch for k in frames]
    kept = [np.argsort(-score, kind="stable")[:BEST] for score in scores]
    unary = [np.array([0.0, *score[order]]) for score, order in zip(scores, kept, strict=True)]
    masks = [found[k].masks[order] for k, order in zip(frames, kept, strict=True)]
    states = _viterbi(unary, [_transitions(masks[i], masks[i + 1], frames[i], frames[i + 1], sampled, model)
                              for i in range(len(frames) - 1)])  # fmt: skip
    chosen = {k: None if state == 0 else masks[i][state - 1] for i, (k, state) in enumerate(zip(frames, states, strict=True))}
    best = {k: float(odds[1:].max(initial=-np.inf)) for k, odds in zip(frames, unary, strict=True)}
    unsure = tuple(k for k in frames if chosen[k] is None and best[k] > model.unsure)
    return TouchPath(chosen, unsure)


def _transitions(
    before: np.ndarray, after: np.ndarray, first: int, last: int, sampled: SampledFrames, model: PathModel
) -> np.ndarray:
    """Log odds (1 + n, 1 + m) of going from each state to each; state 0 is no touch."""
    out = np.full((1 + len(before), 1 + len(after)), -model.change)
    out[0, 0] = 0.0
    for i, mask in enumerate(before):
        moved = carried(mask, first, last, sampled)
        for j, other in enumerate(after):
            overlap = iou(moved, other)
            out[1 + i, 1 + j] = model.same * overlap - model.change * (1 - overlap)
    return out


def _viterbi(unary: Sequence[np.ndarray], between: Sequence[np.ndarray]) -> list[int]:
    """Return the best state of every frame."""
    if not unary:
        return []
    total, back = unary[0], list[np.ndarray]()
    for odds, gain in zip(unary[1:], between, strict=True):
        paths = total[:, None] + gain
        back.append(paths.argmax(0))
        total = paths.max(0) + odds
    states = [int(total.argmax())]
    for best in reversed(back):
        states.append(int(best[states[-1]]))
    return states[::-1]


def carried(mask: np.ndarray, first: int, last: int, sampled: SampledFrames) -> np.ndarray:
    """Carry a mask (h, w) bool by motion from sampled frame `first` to `last`, forwards or backwards; empty across a cut."""
    step = 1 if last > first else -1
    image = mask.astype(np.float32)
    for k in range(first + step, last + step, step) if last != first else ():
        moved = sampled.warp(image, k, step)
        if moved is None:
            return np.zeros_like(mask)
        image = moved
    return np.asarray(image > 0.5)


def fill_between(path: TouchPath, visible: Mapping[int, np.ndarray], hands: Sequence[np.ndarray], sampled: SampledFrames,
                 run: range) -> dict[int, np.ndarray]:  # fmt: skip
    """Carry the objects of the segmented frames to the sampled frames between them, each from the nearer one: frame -> mask.

    visible: sampled frames that show the hand; hands: all hands (h, w) bool of every frame of the run.
    """
    at = np.array(list(path.masks))
    out = {}
    for i, k in enumerate(run):
        nearest = int(at[np.abs(at - k).argmin()]) if len(at) else k
        mask = path.masks.get(nearest)
        if k in visible and mask is not None:
            here = carried(mask, nearest, k, sampled) & ~hands[i]
            if here.any():
                out[k] = here
    return out
