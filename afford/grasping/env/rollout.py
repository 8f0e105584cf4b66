"""Roll out a policy: one episode in each of n worlds, recorded step by step."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np

from afford.grasping.env.grasp_worlds import GraspWorlds
from schemas.episodes import GraspTrace


class Actor(Protocol):
    """Chooses actions: a policy, the base alone, a script or a replay."""

    def act(self, now: GraspWorlds) -> np.ndarray:
        """(n, m) actions in -1..1 for the current states of all worlds."""
        ...


class BaseOnly:
    """Actor that adds nothing to the base."""

    def act(self, now: GraspWorlds) -> np.ndarray:
        """(n, m) zeros."""
        return np.zeros((len(now.tasks), now.motors))


@dataclass(frozen=True, eq=False)
class EpisodeBatch:
    """One episode of each of n worlds, with t rows each; the fields without a doc line are those of GraspTrace, (n, t, ...)."""

    report: dict[str, np.ndarray]
    """(n,) figures (measures.METRICS) at the step at which each episode ended"""
    q: np.ndarray
    palm: np.ndarray
    body: np.ndarray
    tips: np.ndarray
    force: np.ndarray
    force_negative: np.ndarray
    penetration_m: np.ndarray
    action: np.ndarray
    reward: np.ndarray
    """(n, t, r)"""
    terms: tuple[str, ...]
    depth_m: np.ndarray
    """(n, steps) depth of the deepest contact; NaN where hand and object do not touch"""
    goal: np.ndarray
    """(n, 3)"""
    ended: np.ndarray
    """(n,) last row of each episode"""
    rate_hz: float
    """rows per second"""

    def trace(self, k: int, task: str, number: int) -> GraspTrace:
        """Trace of world k, up to the end of its episode."""
        rows = {f.name: getattr(self, f.name)[k, : self.ended[k] + 1] for f in fields(GraspTrace) if f.name in STEPWISE}
        return GraspTrace(name=f"{task}/{number:02d}", task=task, rate_hz=self.rate_hz, terms=self.terms, goal=self.goal[k],
                          **rows)  # fmt: skip


STEPWISE = ("q", "palm", "body", "tips", "force", "force_negative", "penetration_m", "action", "reward")


def rollout(worlds: GraspWorlds, actor: Actor, rngs: list[np.random.Generator]) -> EpisodeBatch:
    """Play one episode in every world, all begun at once."""
    n = len(worlds.tasks)
    worlds.reset(range(n), rngs)
    report = dict[str, np.ndarray]()
    rows, ended = [_row(worlds, np.zeros((n, worlds.motors)), {})], np.zeros(n, int)
    for step in range(1, worlds.config.steps + 1):
        action = actor.act(worlds)
        result = worlds.step(action, rngs)
        rows.append(_row(worlds, action, result.terms))
        over = result.done & (ended == 0)
        now = worlds.report()
        report = {name: np.where(over, now[name], report[name]) for name in report} or now
        ended[over] = step
    stacked = {name: np.stack([row[name] for row in rows], axis=1) for name in STEPWISE if name != "reward"}
    terms = tuple(sorted(worlds.weights))
    reward = np.stack([row["reward"] for row in rows], axis=1)
    return EpisodeBatch(report=report, reward=reward, terms=terms, depth_m=worlds.depths(), goal=worlds.goal(), ended=ended,
                        rate_hz=1 / worlds.config.control_s, **stacked)  # fmt: skip


def _row(worlds: GraspWorlds, action: np.ndarray, terms: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    state, measured = worlds.state(), worlds.measures()
    total = measured.force_held + measured.force_negative
    none = np.zeros(len(action))
    reward = np.stack([terms.get(name, none) for name in sorted(worlds.weights)], axis=1)
    return {"q": state.q, "palm": state.palm, "body": state.body, "tips": state.tips, "force": total,
            "force_negative": measured.force_negative, "penetration_m": measured.penetration_m, "action": action.clip(-1, 1),
            "reward": reward}  # fmt: skip
