"""Traces of grasps by script, as an evaluation writes them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from afford.grasping.env.config import GraspEnvConfig
from afford.grasping.env.grasp_worlds import GraspWorlds
from afford.grasping.env.measures import METRICS
from afford.grasping.env.rollout import STEPWISE, BaseOnly, rollout
from afford.grasping.env.task import from_grasp_task
from schemas.episodes import GraspEpisodes, GraspTrace
from schemas.grasp import GraspTask
from tests.helpers.made_hands import shadow
from tests.helpers.made_scenes import tool


@cache
def hammer(category: str = "hammer", seed: int = 3, use: str = "drive a nail") -> GraspTask:
    """A tool that is to be held by its handle."""
    body = tool(category, seed)
    negative = tuple(part for part in body.parts if part != "handle")
    N_t = body.points[np.isin(body.point_part, [body.parts.index(part) for part in negative])]
    return GraspTask(f"{body.name}/{use}", "train", use, body, negative, "handle", N_t.astype(np.float64), negative,
                     np.zeros((0, 3)))  # fmt: skip


@cache
def grasped(seed: int = 0, **changes: object) -> tuple[GraspTrace, dict[str, float]]:
    """An episode of the script alone, and its figures; `changes` are fields of GraspEnvConfig."""
    core = GraspWorlds(shadow(), (from_grasp_task(hammer()),), GraspEnvConfig(**{"base": "script", **changes}))  # type: ignore[arg-type]  # fields of GraspEnvConfig
    played = rollout(core, BaseOnly(), [np.random.default_rng(seed)])
    core.close()
    return played.trace(0, hammer().name, seed), {name: float(found[0]) for name, found in played.report.items()}


def thinned(trace: GraspTrace, every: int) -> GraspTrace:
    """One row in `every`."""
    rows = {name: getattr(trace, name)[::every] for name in STEPWISE}
    return replace(trace, rate_hz=trace.rate_hz / every, **rows)


def episodes(count: int = 2, every: int = 4) -> GraspEpisodes:
    """Some of them, as one policy's; of their rows one in `every`, so that they are drawn soon."""
    found = [(thinned(trace, every), figures) for trace, figures in map(grasped, range(count))]
    values = np.array([[figures[name] for name in METRICS] for _, figures in found])
    return GraspEpisodes("script-train-mujoco", "script", "train", "mujoco", 0, tuple(trace.task for trace, _ in found),
                         tuple(METRICS), values, np.stack([trace.penetration_m[1:] for trace, _ in found]),
                         tuple(trace for trace, _ in found))  # fmt: skip

