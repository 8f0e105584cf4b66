"""Train a teacher further on bodies of many kinds: it begins over the places of grasp families, as in their evaluation.

The network of a trained teacher is the start, and its prior stays frozen. A world for each body, pose and place; tasks of rare
families have several. In every second world the hand begins a little off its place, since places on predicted parts are.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import cycle, islice
from pathlib import Path

import numpy as np
import torch

from afford.grasping.env.flight_recorder import FlightRecorder
from afford.grasping.env.gym_env import VectorEnv
from afford.grasping.env.placed_worlds import PlacedWorlds, best_place
from afford.grasping.env.reward import scaled_negative_weights
from afford.grasping.policies.load_policy import Policy
from afford.grasping.policies.train_teacher import FrozenPrior, TeacherTrainingConfig, export_teacher, train_sections
from afford.grasping.rl.ppo import ActorCritic
from afford.grasping.sim.scene import Physics
from afford.grasping.sim.scripted import Aim
from afford.training.state import TrainingState
from schemas.grasp import GraspTask
from schemas.hand import HandModel

SAME_M = 0.001
"""places of a body that differ by less are one"""


@dataclass(frozen=True)
class RefinementConfig:
    """Settings of a refinement, as in stages/grasping/body_refinement.py."""

    training: TeacherTrainingConfig
    off_m: float
    off_rad: float
    family_worlds: int
    lambda_n: float
    iterations: int
    rate_hz: int
    carry: bool


class LooselyPlacedWorlds(PlacedWorlds):
    """Worlds of which every second one begins off its place by a normal distribution."""

    off_m, off_rad = 0.0, 0.0
    """standard deviations of the place along the table, and of the yaw of the hand"""

    def _aim(self, k: int, pose: np.ndarray, rng: np.random.Generator) -> Aim:
        exact, off = super()._aim(k, pose, rng), rng.normal(size=3)
        if k % 2:
            return exact
        return Aim(exact.place + self.off_m * np.append(off[:2], 0.0), exact.yaw + self.off_rad * float(off[2]))


def refine_on_bodies(hand: HandModel, tasks: Sequence[GraspTask], policy: Policy, config: RefinementConfig, folder: Path,
                     progress: Callable[[int, int], None]) -> tuple[Path, TrainingState]:  # fmt: skip
    """Train the teacher of a policy further; the folder of the new one, and its curves. ValueError for a policy without one."""
    if policy.teacher is None or policy.facts["base"] == "script":
        raise ValueError("body_refinement: expected a teacher with base=prior or none, got another policy; give the files of "
                         "rl_grasp_refinement")
    plan = config.training
    usual = policy.config("mujoco", Physics(iterations=config.iterations, rate_hz=config.rate_hz), "flat", 0.0)
    env = replace(usual, weights={**usual.weights, **scaled_negative_weights(usual.reward, config.lambda_n)}, seed=plan.seed)
    prior = FrozenPrior(policy.prior, env.layout) if policy.prior is not None else None
    recorder, chosen = FlightRecorder(folder, env.engine, plan.seed), worlds_of(tasks, config.family_worlds)
    worlds = LooselyPlacedWorlds(hand, chosen, env, config.carry, recorder)
    worlds.off_m, worlds.off_rad = config.off_m, config.off_rad
    envs = VectorEnv(worlds, len(chosen))
    try:
        model = _noisy(policy.teacher, plan)
        state = train_sections(envs, model, prior, plan, recorder, folder, progress)
    finally:
        envs.close()
    return export_teacher(folder, model, prior, env, plan.seed), state


def _noisy(teacher: ActorCritic, plan: TeacherTrainingConfig) -> ActorCritic:
    """Teacher that learns again, with the noise of the start of a training."""
    model = teacher.requires_grad_(True)
    with torch.no_grad():
        model.log_std.fill_(float(np.log(plan.std)))
        model.log_std[0] = float(np.log(plan.std_along))
    return model


def worlds_of(tasks: Sequence[GraspTask], family_worlds: int) -> list[GraspTask]:
    """One task of each body, pose and place, with and without N_t; those of rare families again, up to `family_worlds`."""
    known = dict[tuple[object, ...], GraspTask]()
    of_family = defaultdict[str, list[GraspTask]](list)
    for task in tasks:
        place = best_place(task)
        key = (task.body.name, task.name.split("/")[1], *np.round(place.at_m / SAME_M).tolist(), bool(len(task.N_t)))
        if key not in known:
            known[key] = task
            of_family[place.family].append(task)
    again = [one for some in of_family.values() for one in islice(cycle(some), len(some), max(len(some), family_worlds))]
    return [*known.values(), *again]
