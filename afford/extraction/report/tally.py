"""A tally collects scores by name and forgets the undefined ones (NaN: both masks empty)."""

from __future__ import annotations

import math
from collections import defaultdict

from schemas.benchmark import Score


class Tally:
    """Sums and counts by name. Infinite scores (a perfect PSNR) are capped at 99 so that a mean stays a number."""

    def __init__(self) -> None:
        self._total: dict[str, float] = defaultdict(float)
        self._count: dict[str, int] = defaultdict(int)

    def add(self, name: str, score: float) -> None:
        """Count `score` under `name`, unless it is NaN."""
        if not math.isnan(score):
            self._total[name] += min(score, 99.0)
            self._count[name] += 1

    def scores(self) -> tuple[Score, ...]:
        """Everything counted, by name."""
        return tuple(Score(name, self._total[name], self._count[name]) for name in sorted(self._total))
