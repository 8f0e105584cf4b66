"""Load a trained policy from its files: the environment it was trained in, and the actor that applies it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from afford.grasping.env.config import GraspEnvConfig
from afford.grasping.env.grasp_worlds import GraspWorlds
from afford.grasping.env.obs_blocks import block_slices, obs_blocks
from afford.grasping.env.rollout import Actor, BaseOnly
from afford.grasping.policies.student import CONFIG as STUDENT_CONFIG
from afford.grasping.policies.student import StudentActor, read_student
from afford.grasping.rl.policy_files import CONFIG, read_policy
from afford.grasping.rl.ppo import ActorCritic
from afford.grasping.sim.scene import Physics
from schemas.files import FileTree

PRIOR = "prior/"
"""folder of the frozen prior within the files of a teacher"""
ENVIRONMENT = ("base", "posture", "layout", "role", "reward", "weights", "steps", "wait", "lift_m", "start", "start_m",
               "action_mode")  # fmt: skip
"""fields of GraspEnvConfig that a policy depends on; they are among its facts"""


@dataclass(frozen=True, eq=False)
class Policy:
    """Networks of a trained policy, and the facts that were written with them."""

    facts: Mapping[str, Any]
    teacher: ActorCritic | None
    prior: ActorCritic | None
    student: StudentActor | None = None

    @property
    def seed(self) -> int:
        """Seed of the training."""
        return int(self.facts.get("seed", 0))

    def config(self, engine: str, physics: Physics, poses: str, push_n: float) -> GraspEnvConfig:
        """Configuration of the environment that the policy was trained in, on a chosen engine."""
        known = {name: self.facts[name] for name in ENVIRONMENT if name in self.facts}
        return GraspEnvConfig(engine=engine, physics=physics, poses=poses, push_n=push_n, **known)

    def actor(self, worlds: GraspWorlds) -> Actor:
        """Actor that applies the policy in these worlds."""
        if self.student is not None:
            return self.student
        if self.teacher is None and self.prior is None:
            return BaseOnly()
        return MeanAction(self.teacher, self.prior, prior_columns(worlds.config.layout, worlds.config.role))


class MeanAction:
    """Actor that adds the mean actions of teacher and prior element-wise (AffordDex: a = pi_H + pi_T)."""

    def __init__(self, teacher: ActorCritic | None, prior: ActorCritic | None, columns: np.ndarray) -> None:
        self.teacher, self.prior, self.columns = teacher, prior, columns

    @torch.no_grad()
    def act(self, now: GraspWorlds) -> np.ndarray:
        """(n, m) actions within -1..1."""
        obs = torch.as_tensor(now.observe())
        action = np.zeros((len(obs), now.motors))
        if self.prior is not None:
            action += mean_action(self.prior, obs[:, self.columns])
        if self.teacher is not None:
            action += mean_action(self.teacher, obs)
        return action.clip(-1, 1)


def mean_action(model: ActorCritic, obs: torch.Tensor) -> np.ndarray:
    """(n, m) float64 mean of the action distribution, within -1..1, computed on the device of the model."""
    found: np.ndarray = model.actions(obs.to(model.device)).mean.clamp(-1, 1).cpu().numpy().astype(np.float64)
    return found


def prior_columns(layout: str, role: str) -> np.ndarray:
    """Columns of the observation of `role` that form the prior's observation, in its order."""
    mine = block_slices(obs_blocks(layout, role))
    chosen = [mine[block.name] for block in obs_blocks(layout, "prior")]
    return np.concatenate([np.arange(part.start, part.stop) for part in chosen])


def load_policy(files: FileTree, otherwise: Mapping[str, Any]) -> Policy:
    """Load a teacher with its prior, a prior, or a student. Without files: the base alone, with the facts `otherwise`."""
    if not files.files:
        return Policy(otherwise, None, None)
    if files.find(STUDENT_CONFIG):
        model, sensors, facts = read_student(files)
        return Policy(facts, None, None, StudentActor(model, sensors))
    network, facts = read_policy(files)
    if facts["role"] == "prior":
        return Policy(facts, None, network.eval())
    prior = read_policy(files, PRIOR)[0].eval() if files.find(PRIOR + CONFIG) else None
    return Policy(facts, network.eval(), prior)
