"""Trials of actors on the tasks of one body, in worlds of several engines: mean figures of each task."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from afford.grasping.env.placed_worlds import PlacedWorlds
from afford.grasping.env.rollout import Actor

TOUCHING = 0.5
"""share of an episode's score that is lost if all fingertips end at negative points"""
FIGURES = ("score", "success", "held", "as_violation_pct")
Begin = Callable[[PlacedWorlds], Callable[[int], np.ndarray]]
"""begins an episode; a function from step to actions (n, m)"""


def trial_figures(places: Sequence[PlacedWorlds], tasks: int, choose: Begin, seed: Sequence[int]) -> dict[str, np.ndarray]:
    """(t,) mean FIGURES of each task over an episode of every world, engines weighing alike. World k has task k % t."""
    found = [_figures(worlds, tasks, choose, [*seed, k]) for k, worlds in enumerate(places)]
    return {name: np.mean([one[name] for one in found], axis=0) for name in FIGURES}


def acting(actor: Callable[[PlacedWorlds], Actor]) -> Begin:
    """Beginning of an episode of an actor."""

    def begun(worlds: PlacedWorlds) -> Callable[[int], np.ndarray]:
        chosen = actor(worlds)
        return lambda step: chosen.act(worlds)

    return begun


def begin(worlds: PlacedWorlds, seed: Sequence[int]) -> list[np.random.Generator]:
    """Reset all worlds; their generators."""
    rngs = [np.random.default_rng([*seed, k]) for k in range(len(worlds.tasks))]
    worlds.reset(range(len(rngs)), rngs)
    return rngs


def episode_scores(report: dict[str, np.ndarray]) -> np.ndarray:
    """(n,) scores of episodes: the mean of success and held, less for fingertips that end at negative points."""
    out: np.ndarray = (report["success"] + report["held"]) / 2 * (1 - TOUCHING * report["as_violation_pct"] / 100)
    return out


def _figures(worlds: PlacedWorlds, tasks: int, choose: Begin, seed: Sequence[int]) -> dict[str, np.ndarray]:
    rngs = begin(worlds, seed)
    act = choose(worlds)
    for step in range(worlds.config.steps):
        worlds.step(act(step), rngs)
    report = worlds.report()
    report["score"] = episode_scores(report)
    return {name: report[name].reshape(-1, tasks).mean(0) for name in FIGURES}
