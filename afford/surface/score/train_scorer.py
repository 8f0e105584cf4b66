"""Training task of the part scorer: predict share and IoU of candidates and phrases; model card."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits

from afford.surface.describe.looks import part_phrase
from afford.surface.score.part_scorer import PartScorer, PartScorerConfig
from afford.surface.score.samples import rotate_crops
from afford.surface.score.shape_features import SHAPE_FEATURES
from afford.training.state import TrainingState
from schemas.surface import PartLessons

OTHERS = 0.1
"""weight of parts of other categories, which no candidate of this object shows"""
FORMLESS, NOISE = 0.3, 0.05
"""share of candidates whose shape features are zeroed, and noise on the features of the others"""
LETTERS = np.array(list("abcdefghiklmnoprstuw"))
Phrase = Callable[[str, str], str]
"""function from (category, part) to a phrase"""


def init_scorer(config: PartScorerConfig, seed: int) -> PartScorer:
    """Create a scorer with random weights of this seed."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return PartScorer(config)


def scorer_task(model: PartScorer, samples: Sequence[PartLessons], seed: int, objects: int, candidates: int) -> ScorerTask:
    """Create the training task; ValueError without training or validation objects."""
    parts = {split: [one for one in samples if one.split == split] for split in ("train", "val")}
    for split, found in parts.items():
        if not found:
            raise ValueError(f"scorer_train: no object of the split {split}; see object_plan")
    return ScorerTask(model, parts["train"], parts["val"], part_phrase, seed, objects, candidates)


@dataclass(frozen=True, eq=False)
class ScorerBatch:
    """Batch of the part scorer.

    (b, 2, c, s, s) uint8 crops, (b, r) float32 features, k phrases, (b, k, 2) share and IoU, (b, k) weight of each pair.
    """

    crops: np.ndarray
    traits: np.ndarray
    phrases: tuple[str, ...]
    truth: np.ndarray
    weight: np.ndarray


class ScorerTask:
    """Task of the training loop (`afford.training.job.Task`)."""

    monitor = "right"

    def __init__(self, model: PartScorer, learned: Sequence[PartLessons], judged: Sequence[PartLessons], phrase: Phrase, seed: int,
                 objects: int, candidates: int) -> None:
        """Set up batches of `candidates` candidates of each of `objects` objects."""
        self.model: nn.Module = model
        self._net, self._learned, self._judged, self._phrase, self._seed = model, learned, judged, phrase, seed
        self._objects, self._candidates = min(objects, len(learned)), candidates

    def batch(self, number: int) -> ScorerBatch:
        """Draw candidates of some objects, rotated and mirrored, with augmented phrases."""
        rng = np.random.default_rng((self._seed, number))
        chosen = [self._learned[n] for n in rng.choice(len(self._learned), self._objects, replace=False)]
        pairs = sorted({(one.category, part) for one in chosen for part in one.parts})
        rows = [(one, n) for one in chosen for n in rng.choice(len(one.traits), self._candidates)]
        crops = [rotate_crops(one.crops[n], int(rng.integers(4)), bool(rng.random() < 0.5)) for one, n in rows]
        truth, weight = zip(*(_pair_targets(one, n, pairs) for one, n in rows), strict=True)
        phrases = tuple(augment_phrase(self._phrase(*pair), pair[1], rng) for pair in pairs)
        traits = np.stack([augment_traits(one.traits[n], rng) for one, n in rows])
        return ScorerBatch(np.stack(crops), traits, phrases, np.stack(truth), np.stack(weight))

    def loss(self, model: nn.Module, batch: ScorerBatch) -> dict[str, Tensor]:
        """Compute the weighted cross-entropy of share and IoU."""
        logits = model(torch.from_numpy(batch.crops).float() / 255, torch.from_numpy(batch.traits), batch.phrases)
        weight = torch.from_numpy(batch.weight)[..., None]
        each = binary_cross_entropy_with_logits(logits, torch.from_numpy(batch.truth), reduction="none") * weight
        share, overlap = each.sum((0, 1)) / weight.sum()
        return {"total": share + overlap, "share": share, "overlap": overlap}

    def validate(self) -> dict[str, float]:
        """Compute accuracy of the main part, and mean error of the shares, over objects."""
        found = [self._answer(one) for one in self._judged]
        right = [float((shares.argmax(1) == one.share.argmax(1)).mean()) for shares, one in zip(found, self._judged, strict=True)]
        error = [float(np.abs(shares - one.share).mean()) for shares, one in zip(found, self._judged, strict=True)]
        return {"right": float(np.mean(right)), "error": float(np.mean(error))}

    def preview(self, folder: Path, step: int) -> None:
        """Write nothing: the report shows candidates with their scores."""

    def _answer(self, one: PartLessons) -> np.ndarray:
        phrases = tuple(self._phrase(one.category, part) for part in one.parts)
        logits = self._net(torch.tensor(one.crops).float() / 255, torch.tensor(one.traits), phrases)
        return np.asarray(logits[..., 0].sigmoid().numpy())


def augment_traits(traits: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Add noise to the shape features of a candidate (r,), or zero them.

    Exact features would identify the training object, and the network would ignore the crops.
    """
    out = traits.copy()
    count = len(SHAPE_FEATURES)
    out[-count:] = 0 if rng.random() < FORMLESS else out[-count:] + rng.normal(0, NOISE, count)
    return out


def augment_phrase(phrase: str, part: str, rng: np.random.Generator) -> str:
    """Shorten or disguise a phrase such as 'the blade of a saw, a long flat thin plate at the end'.

    The result is the whole phrase, the phrase with nonsense names, its shape alone, its name alone, or the part alone. For an
    unseen object, the shape must be sufficient.
    """
    kind, (named, _, looks) = rng.random(), phrase.partition(", ")
    if kind < 0.25:
        return phrase
    if kind < 0.5:
        return f"the {_nonsense(rng)} of a {_nonsense(rng)}, {looks}"
    return looks if kind < 0.75 else named if kind < 0.9 else part


def _nonsense(rng: np.random.Generator) -> str:
    return "".join(rng.choice(LETTERS, int(rng.integers(4, 9))))


def _pair_targets(one: PartLessons, n: int, pairs: Sequence[tuple[str, str]]) -> tuple[np.ndarray, np.ndarray]:
    """Compute targets (k, 2) and weights (k,) of candidate n for each pair of category and part.

    Own parts have weight 1, parts of other objects OTHERS, or 0 if they have the name of an own part.
    """
    truth, weight = np.zeros((len(pairs), 2), np.float32), np.full(len(pairs), OTHERS, np.float32)
    for k, (category, part) in enumerate(pairs):
        if category == one.category and part in one.parts:
            truth[k] = one.share[n, one.parts.index(part)], one.overlap[n, one.parts.index(part)]
            weight[k] = 1
        elif part in one.parts:
            weight[k] = 0
    return truth, weight


def model_card(samples: Sequence[PartLessons], state: TrainingState) -> str:
    """Write the model card in Markdown."""
    found = {point.name: point.value for point in state.points if point.step == state.best_step}
    counts = Counter(one.split for one in samples)
    kinds = ", ".join(sorted({one.category.replace("_", " ") for one in samples}))
    return f"""# Scorer of parts

Learned from {counts["train"]} procedural objects, judged by {counts["val"]} of the same categories in other shapes: {kinds}.
Kept after step {state.best_step}: {found["val.right"]:.3f} of the candidates have their main part told right, and shares are off by
{found["val.error"]:.3f} on average. These figures chose the step, so they flatter.

It knows shapes, not colours: it sees brightness, outlines and normals. It learned from clean meshes; scans are rougher. Of things
that it never saw it knows what the words for a part's looks say, and no more. It says nothing about whether touching is safe.
"""
