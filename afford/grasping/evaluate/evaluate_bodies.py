"""Evaluate a policy on the tasks of one body, each begun over the place of its grasp family."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import ceil

import numpy as np

from afford.grasping.env.measures import METRICS
from afford.grasping.env.placed_worlds import PlacedWorlds
from afford.grasping.env.rollout import rollout
from afford.grasping.policies.adapted_policy import actor_by_task
from afford.grasping.policies.load_policy import load_policy
from afford.grasping.sim.engine import check_stage_engine
from afford.grasping.sim.scene import Physics
from schemas.episodes import GraspEpisodes, GraspTrace
from schemas.files import FileTree
from schemas.grasp import GraspTask
from schemas.hand import HandModel

FIGURES = tuple(METRICS)


def evaluate_body(name: str, hand: HandModel, tasks: Sequence[GraspTask], files: FileTree, engine: str, episodes: int, at_once: int,
                  traces: int, physics: Physics, seed: int, carry: bool,
                  progress: Callable[[int, int], None]) -> GraspEpisodes:  # fmt: skip
    """Play `episodes` or more, each task equally often; none without a task. ValueError for a policy that does not fit."""
    check_stage_engine(engine)
    policy = load_policy(files, {})
    config = policy.config(engine, physics, "flat", 0.0)
    worlds, rounds = _plan(len(tasks), episodes, at_once)
    names, values, depths, shown = list[str](), [np.zeros((0, len(FIGURES)))], [np.zeros((0, config.steps))], list[GraspTrace]()
    grasping = PlacedWorlds(hand, [tasks[k % len(tasks)] for k in range(worlds)], config, carry) if worlds else None
    actor = actor_by_task(files, policy, grasping) if grasping else None
    for number in range(rounds if grasping else 0):
        assert grasping is not None and actor is not None
        played = rollout(grasping, actor, [np.random.default_rng([seed, k, number]) for k in range(worlds)])
        values.append(np.stack([played.report[figure] for figure in FIGURES], axis=1))
        depths.append(played.depth_m)
        names += [tasks[k % len(tasks)].name for k in range(worlds)]
        shown += [played.trace(k, tasks[k].name, 0) for k in range(min(traces, len(tasks)))] if number == 0 else []
        progress(number + 1, rounds)
    if grasping:
        grasping.close()
    return GraspEpisodes(f"{name}-{engine}", name, "", engine, policy.seed, tuple(names), FIGURES, np.concatenate(values),
                         np.concatenate(depths), tuple(shown))  # fmt: skip


def _plan(tasks: int, episodes: int, at_once: int) -> tuple[int, int]:
    """Return the number of worlds, a multiple of the tasks, and of rounds."""
    if not tasks:
        return 0, 0
    each = ceil(episodes / tasks)
    copies = min(each, max(1, at_once // tasks))
    return tasks * copies, ceil(each / copies)


def join_episodes(name: str, runs: Sequence[GraspEpisodes]) -> GraspEpisodes:
    """Join the episodes of several bodies in one engine, in order. ValueError without any."""
    if not runs:
        raise ValueError(f"{name}: expected the episodes of one body or more, got none; every mesh was refused")
    first = runs[0]
    tasks = tuple(task for one in runs for task in one.task)
    traces = tuple(trace for one in runs for trace in one.traces)
    return GraspEpisodes(f"{name}-{first.engine}", name, "", first.engine, first.seed, tasks, first.figures,
                         np.concatenate([one.values for one in runs]), np.concatenate([one.depth_m for one in runs]), traces)
