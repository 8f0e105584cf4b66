"""Which sample comes when: a function of (seed, position), so that a training can go on from anywhere."""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Sequence
from functools import lru_cache

import numpy as np


class Order:
    """Epochs of `len(labels)` positions each. With `balance` 0 every sample comes once per epoch, with 1 every class equally
    often (over epochs, every sample of a class equally often); between them, by the power of the class's share.
    """

    def __init__(self, labels: Sequence[Hashable], balance: float, seed: int) -> None:
        if not labels:
            raise ValueError("training: expected samples, found none; look at the splits and at what is held out")
        count = Counter(labels)
        weight = np.array([count[label] ** -balance for label in labels])
        self.ends = np.cumsum(weight / weight.sum()) * len(labels)
        self.seed = seed
        self._epoch = lru_cache(maxsize=2)(self._draw)

    def sample(self, position: int) -> tuple[int, int]:
        """(epoch, index of the sample) at a position of the endless sequence."""
        epoch, place = divmod(position, len(self.ends))
        return epoch, int(self._epoch(epoch)[place])

    def _draw(self, epoch: int) -> np.ndarray:
        """Systematic resampling: a comb with one tooth per position, moved by chance; then shuffled."""
        rng = np.random.default_rng((self.seed, epoch))
        teeth = np.arange(len(self.ends)) + rng.random()
        chosen = np.minimum(np.searchsorted(self.ends, teeth, side="right"), len(self.ends) - 1)
        return rng.permutation(chosen)
