"""A policy that adds to a frozen one: a = clip(a_H + a_T, -1, 1), element-wise (AffordDex; papers: section 7.3)."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from afford.grasp.observe import blocks, slices
from afford.rl import saved
from afford.rl.policy import ActorCritic
from afford.rl.ppo import Environments, Moved
from schemas.files import FileTree

PRIOR = "prior/"
"""folder of the prior beside the teacher's own files"""


class Prior:
    """A frozen policy that sees its own share of a teacher's observation."""

    def __init__(self, model: ActorCritic, layout: str) -> None:
        """ValueError when it sees another number of numbers."""
        self.model = model.eval().requires_grad_(False)
        self._columns = columns(layout, "prior", "teacher")
        if model.config.observation != len(self._columns):
            raise ValueError(f"prior: expected a policy that sees the {len(self._columns)} numbers of layout {layout}, role prior, "
                             f"got one that sees {model.config.observation}; train it anew")

    @torch.no_grad()
    def act(self, observation: np.ndarray) -> np.ndarray:
        """(n, m) within -1..1, of the teacher's observation (n, d)."""
        seen = torch.from_numpy(observation[:, self._columns])
        found: np.ndarray = self.model.actions(seen).mean.clamp(-1, 1).numpy()
        return found


class OverBase:
    """Environments of PPO in which a prior acts first, or nobody."""

    def __init__(self, envs: Environments, prior: Prior | None) -> None:
        self._envs, self._prior = envs, prior
        self._observation = np.zeros((0, 0), np.float32)

    def reset(self) -> np.ndarray:
        """First observations (n, d)."""
        self._observation = self._envs.reset()
        return self._observation

    def step(self, action: np.ndarray) -> Moved:
        """Add (n, m) to what the prior does."""
        moved = self._envs.step(added(self._prior, self._observation, action))
        self._observation = moved.observation
        return moved


class Residual:
    """A trained teacher, whole: what it and its prior do together, without noise."""

    def __init__(self, teacher: ActorCritic, prior: Prior | None) -> None:
        self.teacher, self.prior = teacher.eval(), prior

    @torch.no_grad()
    def act(self, observation: np.ndarray) -> np.ndarray:
        """(n, m) actions for observations (n, d) of role teacher."""
        return added(self.prior, observation, self.teacher.actions(torch.from_numpy(observation)).mean.numpy())


def read(files: FileTree, under: str = "") -> tuple[Residual, dict[str, Any]]:
    """A teacher from its files, and its facts. ValueError says which file does not fit."""
    teacher, facts = saved.read(files, under)
    inside = files.find(under + PRIOR + saved.CONFIG) is not None
    prior = Prior(saved.read(files, under + PRIOR)[0], facts["layout"]) if inside else None
    return Residual(teacher, prior), facts


def added(prior: Prior | None, observation: np.ndarray, action: np.ndarray) -> np.ndarray:
    """(n, m): the sum with what the prior does, within -1..1."""
    return (action if prior is None else prior.act(observation) + action).clip(-1, 1)


def columns(layout: str, role: str, of: str) -> np.ndarray:
    """Where the numbers of a role stand among those of another one that sees them all."""
    whole, own = blocks(layout, of), blocks(layout, role)
    if missing := {block.name for block in own} - {block.name for block in whole}:
        raise ValueError(f"observation: expected a role that sees all of {role}, got {of}, which lacks {', '.join(sorted(missing))}")
    at = slices(whole)
    return np.concatenate([np.arange(at[block.name].start, at[block.name].stop) for block in own])
