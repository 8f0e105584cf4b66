"""Class-balanced sampler: the sample at a position is a function of (seed, position), so that a training can resume anywhere."""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Sequence
from functools import lru_cache

import numpy as np


class BalancedSampler:
    """Endless sequence of sample indices in epochs of `len(labels)` positions.

    With `balance` 0 every sample occurs once per epoch. With 1 every class occurs equally often, and over epochs every sample of a
    class too. Values between them weight each class by a power of its frequency.
    """

    def __init__(self, labels: Sequence[Hashable], balance: float, seed: int) -> None:
        if not labels:
            raise ValueError("training: no samples found; check the splits and the held-out groups")
        count = Counter(labels)
        weight = np.array([count[label] ** -balance for label in labels])
        self.ends = np.cumsum(weight / weight.sum()) * len(labels)
        self.seed = seed
        self._epoch = lru_cache(maxsize=2)(self._draw)

    def sample(self, position: int) -> tuple[int, int]:
        """(epoch, sample index) at a position of the endless sequence."""
        epoch, place = divmod(position, len(self.ends))
        return epoch, int(self._epoch(epoch)[place])

    def _draw(self, epoch: int) -> np.ndarray:
        """Systematic resampling: a comb with one tooth per position and a random offset, then a shuffle."""
        rng = np.random.default_rng((self.seed, epoch))
        teeth = np.arange(len(self.ends)) + rng.random()
        chosen = np.minimum(np.searchsorted(self.ends, teeth, side="right"), len(self.ends) - 1)
        return rng.permutation(chosen)
