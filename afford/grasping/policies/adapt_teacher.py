"""Adapt a trained teacher to the tasks of one body, in minutes: scripts that lift it are searched, and cloned into a network.

Scripts are searched (grasp_search.py) for each task in which the teacher scores low in an engine, in the physics of the
evaluation. A script that is better than the teacher, in all engines together, is cloned (clone_scripts.py). The network acts in the
tasks in which it is better than the teacher in episodes of the training; in all others the teacher acts as it was
(adapted_policy.py).

Randomness of the search is a function of the seed, that of a round of its number, so that a killed adaptation resumes to the same
weights from its last round.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from afford.grasping.env.placed_worlds import PlacedWorlds
from afford.grasping.policies.clone_scripts import MARGIN, Cloning, CloningConfig
from afford.grasping.policies.grasp_search import Limits, scripts, search_grasps
from afford.grasping.policies.grasp_trials import FIGURES, Begin, acting, trial_figures
from afford.grasping.policies.load_policy import Policy
from afford.grasping.rl.ppo import ActorCritic
from afford.grasping.sim.scene import Physics
from afford.training.loop import derive_seed
from afford.training.state import TrainingState, load_checkpoint, save_checkpoint
from schemas.grasp import GraspTask
from schemas.hand import HandModel

EXPERTS = "experts.safetensors"
FINALISTS = 2
"""best scripts of a search, which are tried in all engines"""
LEAST = 2
"""fewest worlds of a task in an engine"""
SEARCHED, TRIED = range(2)
"""first number of the seeds of episodes, by purpose"""


@dataclass(frozen=True)
class AdaptationConfig(CloningConfig):
    """Hyperparameters of an adaptation, as in stages/grasping/body_adapt.py."""

    worlds: int
    bullet: int
    generations: int
    trials: int
    sure: int
    enough: float
    iterations: int
    rate_hz: int
    carry: bool


class Experts(NamedTuple):
    """Scripts to clone, and how good the teacher is."""

    tasks: np.ndarray
    """(s,) numbers of the tasks with a script"""
    rows: np.ndarray
    """(s, 17) scripts"""
    teacher: np.ndarray
    """(f,) FIGURES of the teacher, means over all tasks"""


class Adapted(NamedTuple):
    """Result of an adaptation."""

    model: ActorCritic
    """with the best weights; the teacher without a better script"""
    state: TrainingState
    tasks: tuple[str, ...]
    """names of the tasks in which the network is better than the teacher"""


Build = Callable[[Sequence[GraspTask]], list[PlacedWorlds]]


def adapt_teacher(hand: HandModel, tasks: Sequence[GraspTask], policy: Policy, config: AdaptationConfig, folder: Path,
                  progress: Callable[[int, int], None]) -> Adapted:  # fmt: skip
    """Adapt the teacher of a policy to the tasks of a body.

    ValueError for a policy without a teacher, or over the scripted base, whose targets move by themselves.
    """
    if policy.teacher is None or policy.facts["base"] == "script":
        raise ValueError("body_adapt: expected a teacher with base=prior or none, got another policy; give the files of "
                         "rl_grasp_refinement")
    total, build = config.generations + config.rounds, partial(_worlds, hand, policy, config)
    experts = _experts(build, tasks, policy, config, folder, lambda done: progress(done, total))
    if not len(experts.tasks):
        state = TrainingState()
        state.log("val", dict(zip(FIGURES, experts.teacher.tolist(), strict=True)))
        return Adapted(policy.teacher, state, ())
    chosen = [tasks[k] for k in experts.tasks]
    with _closing(build(chosen)) as places:
        cloning = Cloning(policy, policy.teacher, config, places, experts.rows)
        state = cloning.learn(folder, lambda done: progress(config.generations + done, total))
    return Adapted(cloning.model, state, tuple(chosen[k].name for k in np.flatnonzero(cloning.better(state))))


def _experts(build: Build, tasks: Sequence[GraspTask], policy: Policy, config: AdaptationConfig, folder: Path,
             progress: Callable[[int], None]) -> Experts:  # fmt: skip
    """Find scripts that are better than the teacher."""
    if (folder / EXPERTS).exists():
        tensors, _ = load_checkpoint(folder / EXPERTS)
        return _chosen(tensors["rows"].numpy(), tensors["teacher"].numpy())
    with _closing(build(tasks)) as places:
        teacher = trial_figures(places, len(tasks), acting(policy.actor), [config.seed, TRIED])
    wanted = np.flatnonzero(teacher["score"] < config.enough).tolist()
    rows = np.full((len(tasks), 17), np.nan)
    for number, k in enumerate(wanted):
        before = config.generations * number
        with _closing(build([tasks[k]])) as places:
            row, score = _searched(places, config, len(wanted), k,
                                   lambda done, before=before: progress((before + done) // len(wanted)))  # type: ignore[misc]
        if score > teacher["score"][k] + MARGIN:
            rows[k] = row
    means = np.array([teacher[name].mean() for name in FIGURES])
    save_checkpoint(folder / EXPERTS, {"rows": torch.from_numpy(rows), "teacher": torch.from_numpy(means)}, {})
    return _chosen(rows, means)


def _chosen(rows: np.ndarray, teacher: np.ndarray) -> Experts:
    """Experts from the scripts (t, 17) of all tasks, NaN without one."""
    which = np.flatnonzero(np.isfinite(rows).all(axis=1))
    return Experts(which, rows[which], teacher)


def _searched(places: Sequence[PlacedWorlds], config: AdaptationConfig, searches: int, task: int,
              progress: Callable[[int], None]) -> tuple[np.ndarray, float]:  # fmt: skip
    """Best script (17,) of a search in worlds of one task, and its score; all searches of a body share its episodes."""
    limits = Limits(config.generations, max(1, config.trials // searches), config.sure)
    rows = search_grasps(places, 1, limits, FINALISTS, config.noise, derive_seed(config.seed, SEARCHED, task), progress)[0]
    tried = [float(trial_figures(places, 1, _following(row), [config.seed, TRIED])["score"][0]) for row in rows]
    best = int(np.argmax(tried))
    return rows[best], tried[best]


def _following(row: np.ndarray) -> Begin:
    """Beginning of an episode of the script (17,)."""

    def begun(worlds: PlacedWorlds) -> Callable[[int], np.ndarray]:
        targets = scripts(worlds, np.tile(row, (len(worlds.tasks), 1)))
        return lambda step: worlds.towards(targets[:, step])

    return begun


def _worlds(hand: HandModel, policy: Policy, config: AdaptationConfig, tasks: Sequence[GraspTask]) -> list[PlacedWorlds]:
    """Worlds in MuJoCo, for the search, and fewer in PyBullet; the more tasks, the fewer of each."""
    physics, out = Physics(iterations=config.iterations, rate_hz=config.rate_hz), list[PlacedWorlds]()
    for engine, of_all in (("mujoco", config.worlds), ("bullet", config.bullet)):
        if of_all:
            each = [*tasks] * max(LEAST, of_all // len(tasks))
            out.append(PlacedWorlds(hand, each, policy.config(engine, physics, "flat", 0.0), config.carry))
    return out


@contextmanager
def _closing(places: Sequence[PlacedWorlds]) -> Iterator[Sequence[PlacedWorlds]]:
    """Close worlds at the end."""
    try:
        yield places
    finally:
        for one in places:
            one.close()
