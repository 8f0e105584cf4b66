"""A policy in worlds, one episode after another: how each went, and what happened step by step."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np

from afford.grasping.env.core import Grasping
from schemas.episodes import GraspTrace


class Actor(Protocol):
    """Whoever decides."""

    def act(self, now: Grasping) -> np.ndarray:
        """(n, m) actions in -1..1, of all worlds, now."""
        ...


class Still:
    """Leaves all to the base."""

    def act(self, now: Grasping) -> np.ndarray:
        """Zeros."""
        return np.zeros((len(now.tasks), now.motors))


@dataclass(frozen=True, eq=False)
class Round:
    """One episode of each of n worlds, t rows each."""

    report: dict[str, np.ndarray]
    """(n,) figures of metrics.MEANING, at the step at which each episode ended"""
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
    """(n, steps) NaN where hand and object do not touch"""
    goal: np.ndarray
    """(n, 3)"""
    ended: np.ndarray
    """(n,) row at which each ended"""
    rate_hz: float
    """rows a second"""

    def trace(self, k: int, task: str, number: int) -> GraspTrace:
        """What happened in world k."""
        rows = {f.name: getattr(self, f.name)[k, : self.ended[k] + 1] for f in fields(GraspTrace) if f.name in STEPWISE}
        return GraspTrace(name=f"{task}/{number:02d}", task=task, rate_hz=self.rate_hz, terms=self.terms, goal=self.goal[k],
                          **rows)  # fmt: skip


STEPWISE = ("q", "palm", "body", "tips", "force", "force_negative", "penetration_m", "action", "reward")


def play(grasping: Grasping, actor: Actor, rngs: list[np.random.Generator]) -> Round:
    """One episode of every world, all begun at once."""
    everyone = range(len(grasping.tasks))
    grasping.reset(everyone, rngs)
    report = dict[str, np.ndarray]()
    rows, ended = [_row(grasping, np.zeros((len(everyone), grasping.motors)), {})], np.zeros(len(everyone), int)
    for step in range(1, grasping.config.steps + 1):
        action = actor.act(grasping)
        happened = grasping.step(action, rngs)
        rows.append(_row(grasping, action, happened.terms))
        over = (happened.terminated | happened.truncated) & (ended == 0)
        report = _kept(report, grasping.report(), over)
        ended[over] = step
    stacked = {name: np.stack([row[name] for row in rows], axis=1) for name in STEPWISE if name != "reward"}
    terms = tuple(sorted(grasping.weights))
    reward = np.stack([row["reward"] for row in rows], axis=1)
    return Round(report=report, reward=reward, terms=terms, depth_m=grasping.depths(), goal=grasping.goal(), ended=ended,
                 rate_hz=1 / grasping.config.control_s, **stacked)  # fmt: skip


def _row(grasping: Grasping, action: np.ndarray, terms: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    state, measured = grasping.state(), grasping.measures()
    total = measured.force_held + measured.force_negative
    none = np.zeros(len(action))
    reward = np.stack([terms.get(name, none) for name in sorted(grasping.weights)], axis=1)
    return {"q": state.q, "palm": state.palm, "body": state.body, "tips": state.tips, "force": total,
            "force_negative": measured.force_negative, "penetration_m": measured.penetration_m, "action": action.clip(-1, 1),
            "reward": reward}  # fmt: skip


def _kept(report: dict[str, np.ndarray], now: dict[str, np.ndarray], over: np.ndarray) -> dict[str, np.ndarray]:
    """Figures of worlds whose episode is over now, beside those of worlds that were so before."""
    if not report:
        return {name: figure.copy() for name, figure in now.items()}
    return {name: np.where(over, now[name], report[name]) for name in report}
