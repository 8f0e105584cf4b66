"""Traces of grasps by script, as an evaluation writes them."""

from __future__ import annotations

from functools import cache

import numpy as np

from afford.grasp.config import Config
from afford.grasp.core import Grasping
from afford.grasp.measures import Measures
from afford.grasp.metrics import MEANING
from afford.grasp.task import task
from schemas.episodes import GraspEpisodes, GraspTrace
from schemas.grasp_task import GraspTask
from tests.made_hands import shadow
from tests.made_scenes import tool

RATE_HZ = 20.0


@cache
def hammer(category: str = "hammer", seed: int = 3, use: str = "drive a nail") -> GraspTask:
    """A tool that is to be held by its handle."""
    body = tool(category, seed)
    negative = tuple(part for part in body.parts if part != "handle")
    N_t = body.points[np.isin(body.point_part, [body.parts.index(part) for part in negative])]
    return GraspTask(f"{body.name}/{use}", "train", use, body, negative, "handle", N_t.astype(np.float64))


@cache
def grasped(seed: int = 0, **told: object) -> tuple[GraspTrace, dict[str, float]]:
    """An episode of the script alone, and its figures; `told` are words of Config."""
    one = hammer()
    core = Grasping(shadow(), (task(one.body, one.negative, one.hold, one.N_t),), Config(**{"base": "script", **told}))  # type: ignore[arg-type]  # words
    rngs = [np.random.default_rng(seed)]
    core.reset([0], rngs)
    names, rows = tuple(core.weights), [_row(core, core.measures(), dict.fromkeys(core.weights, np.zeros(1)))]
    for _ in range(core.config.steps):
        out = core.step(np.zeros((1, core.motors)), rngs)
        rows.append(_row(core, core.measures(), out.terms))
    figures = {name: float(found[0]) for name, found in core.report().items()}
    goal = core._now.episode.goal[0]
    core.close()
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    return GraspTrace(f"{one.name}/{seed}", one.name, RATE_HZ, terms=names, goal=goal, **columns), figures


def episodes(count: int = 2) -> GraspEpisodes:
    """Some of them, as one policy's."""
    found = [grasped(seed) for seed in range(count)]
    values = np.array([[figures[name] for name in MEANING] for _, figures in found])
    return GraspEpisodes("script-train-mujoco", "script", "train", "mujoco", 0, tuple(trace.task for trace, _ in found),
                         tuple(MEANING), values, tuple(trace for trace, _ in found))  # fmt: skip


def _row(core: Grasping, m: Measures, terms: dict[str, np.ndarray]) -> dict[str, object]:
    state = core.state()
    return {"q": state.q[0], "palm": state.palm[0], "body": state.body[0], "tips": state.tips[0],
            "force": (m.force_held + m.force_negative)[0], "force_negative": m.force_negative[0],
            "penetration_m": m.penetration_m[0], "action": m.action[0],
            "reward": np.array([terms[name][0] for name in core.weights])}  # fmt: skip
