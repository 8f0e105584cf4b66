"""How common every class is in the sequences of a training."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from afford.dataset import packed_sequences
from schemas.interaction import AFFORDANCES, BACKGROUND

UNSEEN = 0.5
"""times that a class counts which does not occur"""


def pixels(paths: Sequence[Path], foreground: float) -> Tensor:
    """(10,) shares of pixels, those that afford something counted `foreground` times; they sum to 1."""
    labels = (packed_sequences.read_label(path).ravel() for path in paths)
    counts = np.sum([np.bincount(label, minlength=BACKGROUND + 1) for label in labels], axis=0).astype(float)
    counts[:BACKGROUND] *= foreground
    return _shares(counts)


def actions(paths: Sequence[Path]) -> Tensor:
    """(9,) shares of sequences; they sum to 1."""
    found = [packed_sequences.affordance_index(packed_sequences.read_classes(path)[1]) for path in paths]
    return _shares(np.bincount(found, minlength=len(AFFORDANCES)).astype(float))


def _shares(counts: np.ndarray) -> Tensor:
    some = np.maximum(counts, UNSEEN)
    return torch.from_numpy(some / some.sum()).float()
