"""Many worlds at once, as arrays (n, ...), on threads: MuJoCo computes outside Python's lock, PyBullet one world after another."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from typing import Any

import numpy as np

from afford.sim.engine import State, World, world
from afford.sim.scene import Scene


class Worlds:
    """n worlds of one engine; scenes may differ in object and physics, not in hand or in the number of parts (see `parts`)."""

    def __init__(self, engine: str, scenes: Sequence[Scene], threads: int = 1) -> None:
        """ValueError for no scenes, or hands that differ in their joints."""
        if not scenes or threads < 1:
            raise ValueError(f"Worlds: expected one scene or more and one thread or more, got {len(scenes)} and {threads}")
        names = {scene.hand.joints.name for scene in scenes}
        if len(names) > 1:
            raise ValueError(f"Worlds: expected one hand, got {len(names)} with other joints")
        self.scenes = tuple(scenes)
        self.parts = max(len(scene.body.parts) for scene in scenes)
        self.worlds: tuple[World, ...] = tuple(world(engine, scene) for scene in scenes)
        self._pool = ThreadPoolExecutor(threads) if threads > 1 else None

    def reset(self, q: np.ndarray, body: np.ndarray, which: Sequence[int] | None = None) -> State:
        """q (k, d) and body (k, 7) for the worlds `which`, or for all."""
        return self._each(lambda k, row: self.worlds[k].reset(q[row], body[row]), which)

    def step(self, u: np.ndarray, control_s: float) -> State:
        """u (n, m)."""
        return self._each(lambda k, row: self.worlds[k].step(u[row], control_s), None)

    def push(self, force: np.ndarray, duration_s: float) -> None:
        """force (n, 3)."""
        for made, row in zip(self.worlds, force, strict=True):
            made.push(row, duration_s)

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
        columns["force"] = [np.pad(force, ((0, 0), (0, self.parts - force.shape[1]))) for force in columns["force"]]
        return State(**{name: np.array(column) for name, column in columns.items()})  # type: ignore[arg-type]  # (n,) for numbers
