"""Evaluate a policy: many episodes on one level in one engine, and example episodes for recordings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil

import numpy as np

from afford.grasping.env.carried_worlds import CarriedWorlds
from afford.grasping.env.grasp_worlds import GraspWorlds
from afford.grasping.env.measures import METRICS
from afford.grasping.env.rollout import EpisodeBatch, rollout
from afford.grasping.env.task import from_grasp_task
from afford.grasping.evaluate.human_likeness import CRITERIA, HumanStatistics, human_likeness, human_statistics, log_jerk
from afford.grasping.policies.load_policy import load_policy
from afford.grasping.sim.engine import check_stage_engine
from afford.grasping.sim.scene import Physics
from schemas.episodes import GraspEpisodes, GraspTrace
from schemas.files import FileTree
from schemas.grasp import GraspTask
from schemas.hand import HandModel, ReferenceSet

FIGURES = (*METRICS, "hls", *(f"hls_{name}" for name in CRITERIA), "log_jerk")
"""of each episode: metrics.MEANING, human_likeness.py"""


@dataclass(frozen=True)
class EvaluationParams:
    """Parameters of an evaluation, as in stages/grasping/grasp_evaluate.py."""

    policy: str
    engine: str
    episodes: int
    at_once: int
    iterations: int
    rate_hz: int
    poses: str
    push_n: float
    base: str
    start: str
    traces: int
    seed: int
    carry: bool

    def __post_init__(self) -> None:
        check_stage_engine(self.engine)


def evaluate_policy(hand: HandModel, tasks: Sequence[GraspTask], files: FileTree, references: ReferenceSet,
                    params: EvaluationParams, progress: Callable[[int, int], None]) -> GraspEpisodes:  # fmt: skip
    """Play episodes in rounds, each task equally often; ValueError for a policy that does not fit."""
    policy = load_policy(files, {"base": params.base, "start": params.start})
    config = policy.config(params.engine, _physics(params), params.poses, params.push_n)
    humans = human_statistics(references.references, 1 / config.control_s)
    rounds = ceil(params.episodes / len(tasks))
    values, depths, names, traces = [], [], [], list[GraspTrace]()
    for first in range(0, len(tasks), params.at_once):
        some = tasks[first : first + params.at_once]
        grasping = (CarriedWorlds if params.carry else GraspWorlds)(hand, [from_grasp_task(one) for one in some], config)
        for number in range(rounds):
            rngs = [np.random.default_rng([params.seed, first + k, number]) for k in range(len(some))]
            played = rollout(grasping, policy.actor(grasping), rngs)
            values.append(_figures(played, humans))
            depths.append(played.depth_m)
            names += [one.name for one in some]
            traces += _traces(played, some, number, first, params.traces, len(tasks))
            progress(first * rounds + (number + 1) * len(some), len(tasks) * rounds)
        grasping.close()
    level = tasks[0].level
    return GraspEpisodes(
        name=f"{params.policy}-{level}-{params.engine}", policy=params.policy, level=level, engine=params.engine, seed=policy.seed,
        task=tuple(names), figures=FIGURES, values=np.concatenate(values),
        depth_m=np.concatenate(depths), traces=tuple(traces))  # fmt: skip


def _physics(params: EvaluationParams) -> Physics:
    return Physics(iterations=params.iterations, rate_hz=params.rate_hz)


def _figures(played: EpisodeBatch, humans: HumanStatistics) -> np.ndarray:
    """Compute (n, k) figures in the order of FIGURES."""
    human = [_human(played.q[k, : end + 1, 6:], played.palm[k, : end + 1, :3], played.rate_hz, humans)
             for k, end in enumerate(played.ended)]
    return np.concatenate([np.stack([played.report[name] for name in METRICS], axis=1), np.array(human)], axis=1)


def _human(q: np.ndarray, palm: np.ndarray, rate_hz: float, humans: HumanStatistics) -> list[float]:
    score, parts = human_likeness(q, palm, rate_hz, humans)
    return [score, *parts.tolist(), (log_jerk(q, rate_hz) + log_jerk(palm, rate_hz)) / 2]


def _traces(played: EpisodeBatch, tasks: Sequence[GraspTask], number: int, first: int, wanted: int, total: int) -> list[GraspTrace]:
    """Return traces of the first round, for tasks spread evenly over all."""
    if number:
        return []
    chosen = set(np.linspace(0, total - 1, min(wanted, total)).round().astype(int).tolist())
    return [played.trace(k, one.name, number) for k, one in enumerate(tasks) if first + k in chosen]


ITERATIONS = 100
"""of the solver, at most"""


def example_episodes(hand: HandModel, tasks: Sequence[GraspTask], files: FileTree, seed: int) -> list[GraspTrace]:
    """Play one episode of each task, in parallel, in MuJoCo, with the policy's mean action and its initial states of training.

    ValueError for files that contain no policy.
    """
    policy = load_policy(files, {})
    config = policy.config("mujoco", Physics(iterations=ITERATIONS), "flat", 0.0)
    grasping = GraspWorlds(hand, [from_grasp_task(one) for one in tasks], config)
    try:
        played = rollout(grasping, policy.actor(grasping), [np.random.default_rng([seed, k]) for k in range(len(tasks))])
    finally:
        grasping.close()
    return [played.trace(k, one.name, 0) for k, one in enumerate(tasks)]


def spread(tasks: Sequence[GraspTask], count: int) -> list[GraspTask]:
    """Choose at most `count` tasks, spread evenly over all."""
    chosen = np.linspace(0, len(tasks) - 1, min(count, len(tasks))).round().astype(int)
    return [tasks[k] for k in dict.fromkeys(chosen.tolist())]
