"""Trained policies at work: what a folder of a policy says of the environment, and who acts in it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from afford.grasping.env.config import Config
from afford.grasping.env.core import Grasping
from afford.grasping.env.evaluate import Actor, Still
from afford.grasping.env.observe import blocks, slices
from afford.grasping.policies import student_files
from afford.grasping.policies.student import Student
from afford.grasping.rl.policy import ActorCritic
from afford.grasping.rl.saved import CONFIG, read
from afford.grasping.sim.scene import Physics
from schemas.files import FileTree

PRIOR = "prior/"
"""folder of the frozen prior within that of a teacher"""
ENVIRONMENT = ("base", "posture", "layout", "role", "reward", "weights", "steps", "wait", "lift_m", "start",
               "start_m",
               "action_mode")  # fmt: skip
"""fields of Config that a policy was trained with, and needs again"""


@dataclass(frozen=True, eq=False)
class Policy:
    """Networks and the facts that were written beside them."""

    facts: Mapping[str, Any]
    teacher: ActorCritic | None
    prior: ActorCritic | None
    student: Student | None = None

    @property
    def seed(self) -> int:
        """Of the training."""
        return int(self.facts.get("seed", 0))

    def config(self, engine: str, physics: Physics, poses: str, push_n: float) -> Config:
        """Of the environment that the policy knows, in an engine."""
        known = {name: self.facts[name] for name in ENVIRONMENT if name in self.facts}
        return Config(engine=engine, physics=physics, poses=poses, push_n=push_n, **known)

    def actor(self, grasping: Grasping) -> Actor:
        """Who acts in these worlds."""
        if self.student is not None:
            return self.student
        if self.teacher is None and self.prior is None:
            return Still()
        return Mean(self.teacher, self.prior, prior_columns(grasping.config.layout, grasping.config.role))


class Mean:
    """Acts by the means of the networks, added number by number (AffordDex: a = pi_H + pi_T)."""

    def __init__(self, teacher: ActorCritic | None, prior: ActorCritic | None, columns: np.ndarray) -> None:
        self.teacher, self.prior, self.columns = teacher, prior, columns

    @torch.no_grad()
    def act(self, now: Grasping) -> np.ndarray:
        """(n, m)."""
        seen = torch.from_numpy(now.observe())
        action = np.zeros((len(seen), now.motors))
        if self.prior is not None:
            action += mean(self.prior, seen[:, self.columns])
        if self.teacher is not None:
            action += mean(self.teacher, seen)
        return action.clip(-1, 1)


def mean(model: ActorCritic, seen: torch.Tensor) -> np.ndarray:
    """(n, m) what a policy does, within -1..1."""
    found: np.ndarray = model.actions(seen).mean.clamp(-1, 1).numpy().astype(np.float64)
    return found


def prior_columns(layout: str, role: str) -> np.ndarray:
    """Which numbers of what `role` sees are those that the prior sees, in its order."""
    mine = slices(blocks(layout, role))
    chosen = [mine[block.name] for block in blocks(layout, "prior")]
    return np.concatenate([np.arange(part.start, part.stop) for part in chosen])


def load(files: FileTree, otherwise: Mapping[str, Any]) -> Policy:
    """A teacher with the prior in it, a prior, a student, or no files: the base alone, in the environment `otherwise`."""
    if not files.files:
        return Policy(otherwise, None, None)
    if files.find(student_files.CONFIG):
        pupil, senses, facts = student_files.read(files)
        return Policy(facts, None, None, Student(pupil, senses))
    model, facts = read(files)
    if facts["role"] == "prior":
        return Policy(facts, None, model.eval())
    prior = read(files, PRIOR)[0].eval() if files.find(PRIOR + CONFIG) else None
    return Policy(facts, model.eval(), prior)
