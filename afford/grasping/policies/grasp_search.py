"""Search scripted grasps of bodies over their places, by trial in simulation: demonstrations for the adaptation of a policy.

A demonstration is a script of 17 numbers (sim/scripted.py): the hand moves from the start posture of the policy to above the place,
comes down, closes and lifts. The search is an evolution strategy for each task. The first generation is spread widely around the
script for tools; later ones change the best scripts so far, in ever smaller steps. Each generation also tries the best ones again,
because a trial has noise on its actions, so that grasps win that bear small errors. The objective is the return of the policy's own
reward, which also counts negative points. A search ends when every task has a script that holds in all engines, or when its
episodes are spent.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass
from itertools import chain

import numpy as np

from afford.grasping.env.actions import initial_joints
from afford.grasping.env.placed_worlds import PlacedWorlds
from afford.grasping.hand.kinematics import commanded_columns
from afford.grasping.sim.scene import Scene
from afford.grasping.sim.scripted import DESCEND, GRASP, LIFT_M, Aim, Grasp, grasp_commands

REACH, DOWN, CLOSE, LIFT = 8, 5, 9, 12
"""control steps of the motion to above the place, and of the next three; the rest holds"""
ABOVE_M = 0.05
SPREAD = np.array([0.015, 0.02, 0.02, 0.2, 0.25, 0.15, 0.2, 0.2, 0.25, 0.25, 0.25, 0.15, 0.15, 0.1, 0.15, 0.3, 0.01])
"""standard deviations of the numbers of a script in the first generation, m or rad"""
DECAY, FINEST, CHANGED = 0.8, 0.15, 0.6
"""factor of the spread from one generation to the next, its least value, and the chance that a number is changed"""
PARENTS, AGAIN = 4, 3
"""scripts that are changed, and that are tried again, in a generation"""
DOUBT = 1.0
"""a script's return counts less by this over the root of its trials"""


class GraspSearch:
    """Evolution strategy over the scripts of one task, which are tried in several engines."""

    def __init__(self, seed: Sequence[int], engines: int) -> None:
        self._rng = np.random.default_rng(seed)
        self._rows, self._returns, self._held = list[np.ndarray](), list[list[list[float]]](), list[list[bool]]()
        self._asked, self._generation, self._engines = list[int](), 0, engines

    def ask(self, count: int) -> np.ndarray:
        """(count, 17) scripts of the next generation: the best ones so far and new ones."""
        known = self._ranked()[: min(AGAIN, count - 1)]
        sigma = max(FINEST, DECAY**self._generation)
        fresh = [self._changed(sigma) if known else numbers(GRASP) + SPREAD * self._rng.standard_normal(len(SPREAD)) * (k > 0)
                 for k in range(count - len(known))]  # fmt: skip
        self._asked = [*known, *range(len(self._rows), len(self._rows) + len(fresh))]
        self._rows += fresh
        self._returns += [[[] for _ in range(self._engines)] for _ in fresh]
        self._held += [[] for _ in fresh]
        self._generation += 1
        return np.stack([self._rows[k] for k in self._asked])

    def ask_again(self, count: int) -> np.ndarray:
        """(count, 17) best scripts so far."""
        self._asked = np.resize(self._ranked()[:count], count).tolist()
        return np.stack([self._rows[k] for k in self._asked])

    def tell(self, engine: int, returns: np.ndarray, held: np.ndarray) -> None:
        """Enter returns and holds (count,) of the scripts that were asked for last, tried in engine number `engine`."""
        for k, one, holds in zip(self._asked, returns.tolist(), held.tolist(), strict=True):
            self._returns[k][engine].append(one)
            self._held[k].append(bool(holds))

    def found(self, sure: int) -> bool:
        """Test whether a script held in all of its trials, `sure` or more in each engine."""
        return any(all(held) and min(map(len, tried)) >= sure for held, tried in zip(self._held, self._returns, strict=True))

    def best(self, count: int) -> np.ndarray:
        """(count, 17) best scripts so far, first those that were tried in every engine."""
        ranked = sorted(self._ranked(), key=lambda k: not all(self._returns[k]))
        return np.stack([self._rows[k] for k in np.resize(ranked[:count], count)])

    def _changed(self, sigma: float) -> np.ndarray:
        parents = self._ranked()[:PARENTS]
        parent = self._rows[parents[min(int(self._rng.exponential(1.2)), len(parents) - 1)]]
        step = sigma * SPREAD * self._rng.standard_normal(len(SPREAD))
        out: np.ndarray = parent + step * (self._rng.random(len(SPREAD)) < CHANGED)
        return out

    def _ranked(self) -> list[int]:
        """Numbers of the scripts that were tried, best first: by the mean over engines of mean returns, less the doubt."""
        score = [np.mean([np.mean(one) for one in found if one]) - DOUBT / np.sqrt(sum(map(len, found))) if any(found) else -np.inf
                 for found in self._returns]  # fmt: skip
        return [int(k) for k in np.argsort(-np.array(score), kind="stable") if np.isfinite(score[k])]


@dataclass(frozen=True)
class Limits:
    """Limits of a search."""

    generations: int
    trials: int
    """episodes of all tasks in all engines together; the first generation is always tried"""
    sure: int
    """trials in each engine, in all of which a script holds, that end the search of its task"""


def search_grasps(places: Sequence[PlacedWorlds], tasks: int, limits: Limits, finalists: int, noise: float, seed: int,
                  progress: Callable[[int], None]) -> np.ndarray:  # fmt: skip
    """Search scripts of tasks; (tasks, finalists, 17), best first. World k has task k % tasks.

    New scripts are tried in the first of the worlds `places`, of one engine each, and the best ones of a generation in the others.
    """
    searches = [GraspSearch([seed, task], len(places)) for task in range(tasks)]
    most = max(1, limits.trials // sum(len(worlds.tasks) for worlds in places))
    for number in range(min(limits.generations, most)):
        for engine, worlds in enumerate(places):
            asked = [(search.ask_again if engine else search.ask)(len(worlds.tasks) // tasks) for search in searches]
            rows = np.stack(asked, axis=1).reshape(len(worlds.tasks), -1)
            returns, held = try_scripts(worlds, rows, noise, [seed, number, engine])
            for task, search in enumerate(searches):
                search.tell(engine, returns[task::tasks], held[task::tasks])
        progress(number + 1)
        if all(search.found(limits.sure) for search in searches):
            break
    return np.stack([search.best(finalists) for search in searches])


def try_scripts(worlds: PlacedWorlds, rows: np.ndarray, noise: float, seed: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """(n,) returns and holds of one episode of every world, which follows its script of `rows` (n, 17), with noise."""
    rngs = [np.random.default_rng([*seed, k]) for k in range(len(worlds.tasks))]
    worlds.reset(range(len(rngs)), rngs)
    targets, total = scripts(worlds, rows), np.zeros(len(rngs))
    for step in range(worlds.config.steps):
        action = worlds.towards(targets[:, step])
        total += worlds.step(action + noise * np.stack([rng.normal(size=action.shape[1]) for rng in rngs]), rngs).reward
    return total, worlds.report()["held"] > 0


def scripts(worlds: PlacedWorlds, rows: np.ndarray) -> np.ndarray:
    """(n, steps, m) targets of the scripts `rows` (n, 17), for objects as they lie."""
    c = worlds.config
    return np.stack([script(scene, aim, shaped(row), c.posture, c.steps, c.lift_m)
                     for scene, aim, row in zip(worlds.scenes, worlds.aims, rows, strict=True)])  # fmt: skip


def script(scene: Scene, aim: Aim, grasp: Grasp, posture: Sequence[float], steps: int, lift_m: float) -> np.ndarray:
    """(steps, m) targets from the start posture to a grasp at an aim, lifted by `lift_m` and held."""
    start = initial_joints(scene, aim, posture)[commanded_columns(scene.hand.joints)]
    commands = np.array(list(grasp_commands(scene, aim, grasp)))
    at, closed = commands[DESCEND - 1], commands[-1] - LIFT_M * _up(len(start))
    turn = 2 * np.pi * np.round((start[3] - at[3]) / (2 * np.pi))
    at[3] += turn
    closed[3] += turn
    frames = [start, at + ABOVE_M * _up(len(start)), at, closed, closed + lift_m * _up(len(start))]
    moves = [before + _eased(count) * (after - before)
             for before, after, count in zip(frames, frames[1:], (REACH, DOWN, CLOSE, LIFT), strict=False)]  # fmt: skip
    out = np.concatenate([*moves, np.tile(frames[-1], (max(0, steps - sum(map(len, moves))), 1))])
    return out[:steps]


def numbers(grasp: Grasp) -> np.ndarray:
    """(17,) numbers of a script."""
    return np.array(list(chain.from_iterable(v if isinstance(v, tuple) else (v,) for v in astuple(grasp))))


def shaped(row: np.ndarray) -> Grasp:
    """Build the script of (17,) numbers."""
    x = [float(number) for number in row]
    return Grasp((x[0], x[1], x[2]), x[3], x[4], x[5], x[6], x[7], x[8], x[9], x[10], (x[11], x[12], x[13], x[14], x[15]), x[16])


def _eased(count: int) -> np.ndarray:
    """(count, 1) from 1 / count to 1, eased at both ends."""
    s = np.arange(1, count + 1)[:, None] / count
    out: np.ndarray = s * s * (3 - 2 * s)
    return out


def _up(motors: int) -> np.ndarray:
    return np.eye(motors)[2]
