"""A policy that learns on top of a frozen one: a = clip(a_H + a_T, -1, 1), element-wise (AffordDex)."""

from __future__ import annotations

import numpy as np
import torch

from afford.grasping.policies.acting import mean, prior_columns
from afford.grasping.rl.policy import ActorCritic
from afford.grasping.rl.ppo import Environments, Moved


class Prior:
    """A frozen policy that sees its own share of a teacher's observation."""

    def __init__(self, model: ActorCritic, layout: str) -> None:
        """ValueError when it sees another number of numbers."""
        self.model = model.eval().requires_grad_(False)
        self._columns = prior_columns(layout, "teacher")
        if model.config.observation != len(self._columns):
            raise ValueError(f"prior: expected a policy that sees the {len(self._columns)} numbers of layout {layout}, role prior, "
                             f"got one that sees {model.config.observation}; train it anew")

    @torch.no_grad()
    def act(self, observation: np.ndarray) -> np.ndarray:
        """(n, m) within -1..1, from a teacher's observation (n, d)."""
        return mean(self.model, torch.from_numpy(observation[:, self._columns]))


class OverBase:
    """Environments of PPO in which a prior acts first, or nobody. What the prior wants and what is added are each within -1..1."""

    def __init__(self, envs: Environments, prior: Prior | None) -> None:
        self._envs, self._prior = envs, prior
        self._wanted = np.zeros((0, 0))

    def reset(self) -> np.ndarray:
        """First observations (n, d)."""
        return self._seen(self._envs.reset())

    def step(self, action: np.ndarray) -> Moved:
        """Add (n, m)."""
        both = action if self._prior is None else self._wanted + action.clip(-1, 1)
        moved = self._envs.step(both.clip(-1, 1))
        self._seen(moved.observation)
        return moved

    def _seen(self, observation: np.ndarray) -> np.ndarray:
        if self._prior is not None:
            self._wanted = self._prior.act(observation)
        return observation
