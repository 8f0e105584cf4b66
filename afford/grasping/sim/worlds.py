"""Many worlds in this process, on threads: MuJoCo computes outside Python's lock, PyBullet one world after another."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from typing import Any

import numpy as np

from afford.grasping.sim.engine import State, World, world
from afford.grasping.sim.scene import Scene


def most_parts(scenes: Sequence[Scene]) -> int:
    """Of the objects of scenes that can be computed side by side; ValueError for none, or for hands that differ in their joints."""
    names = {scene.hand.joints.name for scene in scenes}
    if len(names) != 1:
        raise ValueError(f"Worlds: expected one scene or more, with one hand, got {len(scenes)} with {len(names)} hands")
    return max(len(scene.body.parts) for scene in scenes)


class Worlds:
    """See afford.grasping.sim.batch.Batch. `parts`: the most that an object has; forces on others are padded with 0."""

    def __init__(self, engine: str, scenes: Sequence[Scene], threads: int = 1) -> None:
        """ValueError for no scenes, hands that differ in their joints, or no threads."""
        if threads < 1:
            raise ValueError(f"Worlds: expected one thread or more, got {threads}")
        self.scenes, self.parts = tuple(scenes), most_parts(scenes)
        self.worlds: tuple[World, ...] = tuple(world(engine, scene) for scene in scenes)
        self._pool = ThreadPoolExecutor(threads) if threads > 1 else None

    def alone(self, k: int) -> World:
        """World k."""
        return self.worlds[k]

    def reset(self, q: np.ndarray, body: np.ndarray, which: Sequence[int] | None = None) -> State:
        """q (k, d) and body (k, 7) for the worlds `which`, or for all."""
        return self._each(lambda k, row: self.worlds[k].reset(q[row], body[row]), which)

    def step(self, u: np.ndarray, control_s: float) -> State:
        """u (n, m)."""
        return self._each(lambda k, row: self.worlds[k].step(u[row], control_s), None)

    def push(self, force: np.ndarray, duration_s: float, which: Sequence[int] | None = None) -> None:
        """force (k, 3) on the objects of worlds `which`, or of all."""
        for k, row in zip(range(len(self.worlds)) if which is None else which, force, strict=True):
            self.worlds[k].push(row, duration_s)

    def state(self) -> State:
        """What is known now."""
        return self._each(lambda k, row: self.worlds[k].state(), None)

    def save(self) -> tuple[Any, ...]:
        """A token of every world."""
        return tuple(made.save() for made in self.worlds)

    def restore(self, tokens: Sequence[Any]) -> State:
        """Every world back to its token."""
        return self._each(lambda k, row: self.worlds[k].restore(tokens[row]), None)

    def close(self) -> None:
        """Close all; twice is harmless."""
        for made in self.worlds:
            made.close()
        if self._pool is not None:
            self._pool.shutdown()

    def _each(self, act: Callable[[int, int], State], which: Sequence[int] | None) -> State:
        chosen = range(len(self.worlds)) if which is None else which
        rows = range(len(chosen))
        found = (self._pool.map if self._pool else map)(act, chosen, rows)
        return self._stacked(list(found))

    def _stacked(self, states: Sequence[State]) -> State:
        """One State of arrays (n, ...); force (n, fingers + 1, most parts) is 0 where an object has fewer parts."""
        columns = {f.name: [getattr(state, f.name) for state in states] for f in fields(State)}
        force = np.zeros((len(states), len(states[0].force), self.parts))
        for row, one in zip(force, columns.pop("force"), strict=True):
            row[:, : one.shape[1]] = one
        arrays: dict[str, Any] = {name: np.array(column) for name, column in columns.items()}
        return State(force=force, **arrays)
