"""From scored candidates to what each pixel says: is a hand unwelcome here?

The parts of an object compete for each candidate: what fits a blade better than a handle is blade, even where neither fits well.
Every part is somewhere, so one that fits nothing well counts for more where it fits best. Several candidates cover a pixel: those
that are sure and those that are small count most, so that a switch is not outvoted by all that it is a part of; those that fit no
part do not count.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from schemas.surface import PartCandidates, PartDescription, PartDescriptions, PartScores

SHARPEN = 2.0
"""exponent of the shares before parts compete"""
LIFTED = 0.98
"""quantile, over an object's candidates, of how well they fit a part: what counts as its best"""
LEAST_BEST = 0.05
"""a part whose best is worse than this is not lifted further"""
REJECTED = 0.1
"""a candidate that fits no part better than this says nothing"""
UNSURE = 0.02
"""what a candidate counts that fits all parts alike"""


def pixel_probability(candidates: PartCandidates, scores: PartScores, description: PartDescription,
           face: np.ndarray) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Probability (n, h, w) float32 that a pixel of each view is negative, and the weight (n, h, w) of those that said so, 0 where
    no candidate covers it. `face` (n, h, w): that of each pixel, -1 beside the object.
    """
    value, counts = part_posterior(scores, description)
    shown = (face >= 0).sum((1, 2))[candidates.view]
    size = candidates.masks.sum((1, 2)) / np.maximum(shown, 1)
    return weighted_pixel_mean(candidates, value, (counts / np.maximum(size, 1e-6)).astype(np.float32), face.shape)


def weighted_pixel_mean(candidates: PartCandidates, value: np.ndarray, weight: np.ndarray,
           shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Values (m,) of candidates -> their weighted mean at every pixel (n, h, w) float32, and the sum of the weights (m,) there."""
    said, total = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    for view, mask, v, w in zip(candidates.view, candidates.masks, value, weight, strict=True):
        said[view][mask] += v * w
        total[view][mask] += w
    return np.divide(said, total, out=said, where=total > 0), total


def split_by_task(descriptions: PartDescriptions, scores: PartScores) -> Iterator[tuple[PartDescription, PartScores]]:
    """Every description with the columns of the scores that are its own."""
    at = 0
    for one in descriptions.descriptions:
        mine = slice(at, at := at + len(one.notes))
        yield one, PartScores(scores.name, scores.share[:, mine], scores.overlap[:, mine])


def part_posterior(scores: PartScores, description: PartDescription) -> tuple[np.ndarray, np.ndarray]:
    """(m,) float32 share of each candidate that is negative, and how much it counts."""
    count = len(description.notes)
    if not count:
        return np.zeros(len(scores.share), np.float32), np.zeros(len(scores.share), np.float32)
    fit = _unnormalised_posterior(scores)
    share = fit / np.maximum(fit.sum(1, keepdims=True), 1e-12)
    value = share[:, [note.role == "negative" for note in description.notes]].sum(1)
    sure = np.ones(len(share)) if count == 1 else (share.max(1) - 1 / count) / (1 - 1 / count)
    counts = np.where(scores.share.max(1) > REJECTED, UNSURE + sure, 0)
    return value.astype(np.float32), counts.astype(np.float32)


def _unnormalised_posterior(scores: PartScores) -> np.ndarray:
    """(m, k) float64: how strongly each part claims each candidate, by what it shows and by how well it is all of the part."""
    claim = scores.share.astype(np.float64) * np.sqrt(scores.overlap)
    best = np.quantile(claim, LIFTED, axis=0) if len(claim) else np.ones(claim.shape[1])
    return np.asarray((claim / np.sqrt(np.maximum(best, LEAST_BEST))) ** SHARPEN)
