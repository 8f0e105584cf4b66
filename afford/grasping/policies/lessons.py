"""n grasps in which a student learns from an expert: afford.grasping.rl.dagger.Worlds."""

from __future__ import annotations

import numpy as np

from afford.grasping.env.core import Grasping
from afford.grasping.env.evaluate import Actor
from afford.grasping.policies.sight import Seen
from afford.grasping.policies.student import Senses, Sight


class Lessons:
    """Worlds, cameras, an expert."""

    def __init__(self, core: Grasping, expert: Actor, senses: Senses, seed: int) -> None:
        self.core, self.expert, self.seed, self.steps = core, expert, seed, core.config.steps
        self.sight = Sight(core, senses)
        self._rngs: list[np.random.Generator] = []

    def begin(self, round_: int) -> Seen:
        """Everywhere, as the seed, the number of the round and that of the world say."""
        n = len(self.core.tasks)
        self._rngs = [np.random.default_rng([self.seed, round_, k]) for k in range(n)]
        self.core.reset(range(n), self._rngs)
        self.sight.reseed(int(np.random.default_rng([self.seed, round_]).integers(2**62)))
        return self.sight.look()

    def label(self) -> np.ndarray:
        """(n, m) in the frame of the start."""
        return self.sight.own(self.expert.act(self.core))

    def step(self, action: np.ndarray) -> Seen:
        """Act (n, m) in the frame of the start."""
        self.core.step(self.sight.given(action), self._rngs)
        return self.sight.look()

    def report(self) -> dict[str, np.ndarray]:
        """Of the episodes as they stand now."""
        return self.core.report()
