"""The task of the part scorer: candidates and phrases in, which share of each shows the part and how well they overlap out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits

from afford.surface.describe.looks import phrase
from afford.surface.parts.crops import turned
from afford.surface.parts.form import FORM
from afford.surface.parts.model import Parts, PartsConfig
from schemas.surface import PartLessons

OTHERS = 0.1
"""what parts of other categories count, which no candidate of this one shows"""
FORMLESS, NOISE = 0.3, 0.05
"""share of candidates that are shown without their form, and the noise on it elsewhere"""
LETTERS = np.array(list("abcdefghiklmnoprstuw"))
Phrase = Callable[[str, str], str]
"""(category, part) -> the part in words"""


def seeded(config: PartsConfig, seed: int) -> Parts:
    """A scorer with the random weights of this seed."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return Parts(config)


def task(model: Parts, lessons: Sequence[PartLessons], seed: int, objects: int, candidates: int) -> PartsTask:
    """The task of the loop; ValueError when there is nothing to learn from or nothing that judges."""
    parts = {split: [one for one in lessons if one.split == split] for split in ("train", "val")}
    for split, found in parts.items():
        if not found:
            raise ValueError(f"scorer_train: expected objects of the split {split}, got none; see object_plan")
    return PartsTask(model, parts["train"], parts["val"], phrase, seed, objects, candidates)


@dataclass(frozen=True, eq=False)
class PartsBatch:
    """(b, 2, c, s, s) uint8, (b, r) float32, k phrases, (b, k, 2) share and overlap, (b, k) weight of each pair."""

    crops: np.ndarray
    traits: np.ndarray
    phrases: tuple[str, ...]
    truth: np.ndarray
    weight: np.ndarray


class PartsTask:
    """What the loop trains (`afford.training.job.Task`)."""

    monitor = "right"

    def __init__(self, model: Parts, learned: Sequence[PartLessons], judged: Sequence[PartLessons], phrase: Phrase, seed: int,
                 objects: int, candidates: int) -> None:
        """A batch has `candidates` of each of `objects` objects."""
        self.model: nn.Module = model
        self._net, self._learned, self._judged, self._phrase, self._seed = model, learned, judged, phrase, seed
        self._objects, self._candidates = min(objects, len(learned)), candidates

    def batch(self, number: int) -> PartsBatch:
        """Candidates of some objects, turned and mirrored, and their parts in words that vary."""
        rng = np.random.default_rng((self._seed, number))
        chosen = [self._learned[n] for n in rng.choice(len(self._learned), self._objects, replace=False)]
        pairs = sorted({(one.category, part) for one in chosen for part in one.parts})
        rows = [(one, n) for one in chosen for n in rng.choice(len(one.traits), self._candidates)]
        crops = [turned(one.crops[n], int(rng.integers(4)), bool(rng.random() < 0.5)) for one, n in rows]
        truth, weight = zip(*(_asked(one, n, pairs) for one, n in rows), strict=True)
        phrases = tuple(varied(self._phrase(*pair), pair[1], rng) for pair in pairs)
        traits = np.stack([blurred(one.traits[n], rng) for one, n in rows])
        return PartsBatch(np.stack(crops), traits, phrases, np.stack(truth), np.stack(weight))

    def loss(self, model: nn.Module, batch: PartsBatch) -> dict[str, Tensor]:
        """Cross-entropy of both answers, weighted."""
        logits = model(torch.from_numpy(batch.crops).float() / 255, torch.from_numpy(batch.traits), batch.phrases)
        weight = torch.from_numpy(batch.weight)[..., None]
        each = binary_cross_entropy_with_logits(logits, torch.from_numpy(batch.truth), reduction="none") * weight
        share, overlap = each.sum((0, 1)) / weight.sum()
        return {"total": share + overlap, "share": share, "overlap": overlap}

    def validate(self) -> dict[str, float]:
        """Over objects: share of candidates whose main part is told, and mean error of the shares."""
        found = [self._answer(one) for one in self._judged]
        right = [float((said.argmax(1) == one.share.argmax(1)).mean()) for said, one in zip(found, self._judged, strict=True)]
        error = [float(np.abs(said - one.share).mean()) for said, one in zip(found, self._judged, strict=True)]
        return {"right": float(np.mean(right)), "error": float(np.mean(error))}

    def preview(self, folder: Path, step: int) -> None:
        """Nothing to see: the report shows candidates with their scores."""

    def _answer(self, one: PartLessons) -> np.ndarray:
        phrases = tuple(self._phrase(one.category, part) for part in one.parts)
        logits = self._net(torch.tensor(one.crops).float() / 255, torch.tensor(one.traits), phrases)
        return np.asarray(logits[..., 0].sigmoid().numpy())


def blurred(traits: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The numbers of a candidate (r,), its form with a little noise or, often, none at all: numbers so exact would tell which
    object it is, and pictures would not be looked at.
    """
    out = traits.copy()
    out[-len(FORM) :] = 0 if rng.random() < FORMLESS else out[-len(FORM) :] + rng.normal(0, NOISE, len(FORM))
    return out


def varied(phrase: str, part: str, rng: np.random.Generator) -> str:
    """A phrase such as 'the blade of a saw, a long flat thin plate at the end': whole, with names that mean nothing, only how it
    looks, only what it is, or only the part. Of a thing that is new, its looks must tell.
    """
    kind, (named, _, looks) = rng.random(), phrase.partition(", ")
    if kind < 0.25:
        return phrase
    if kind < 0.5:
        return f"the {_nonsense(rng)} of a {_nonsense(rng)}, {looks}"
    return looks if kind < 0.75 else named if kind < 0.9 else part


def _nonsense(rng: np.random.Generator) -> str:
    return "".join(rng.choice(LETTERS, int(rng.integers(4, 9))))


def _asked(one: PartLessons, n: int, pairs: Sequence[tuple[str, str]]) -> tuple[np.ndarray, np.ndarray]:
    """(k, 2) truth and (k,) weight of candidate n for each pair: its own parts count fully, those of other things a little, unless
    they have the name of one of its own.
    """
    truth, weight = np.zeros((len(pairs), 2), np.float32), np.full(len(pairs), OTHERS, np.float32)
    for k, (category, part) in enumerate(pairs):
        if category == one.category and part in one.parts:
            truth[k] = one.share[n, one.parts.index(part)], one.overlap[n, one.parts.index(part)]
            weight[k] = 1
        elif part in one.parts:
            weight[k] = 0
    return truth, weight
