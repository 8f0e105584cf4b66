"""Many worlds at once, as arrays (n, ...), however they are computed: on threads, in processes, or by an engine that computes all
of them together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np

from afford.common.registry import load
from afford.grasping.sim.apart import Apart
from afford.grasping.sim.engine import BACKENDS, State, World
from afford.grasping.sim.scene import Scene
from afford.grasping.sim.worlds import Worlds

TOGETHER = {"warp": "afford.grasping.sim.warp_worlds:WarpWorlds"}
"""engines that compute all worlds at once, on a device"""
ENGINES = (*sorted(BACKENDS), *sorted(TOGETHER))


class Batch(Protocol):
    """n worlds; scenes may differ in object and physics, not in hand. Everything is a copy."""

    def alone(self, k: int) -> World:
        """World k by itself, to see where its object comes to rest. Where worlds are only computed together, it is MuJoCo's."""

    def reset(self, q: np.ndarray, body: np.ndarray, which: Sequence[int] | None = None) -> State:
        """q (k, d) and body (k, 7) for the worlds `which`, or for all; their states."""

    def step(self, u: np.ndarray, control_s: float) -> State:
        """u (n, m)."""

    def push(self, force: np.ndarray, duration_s: float, which: Sequence[int] | None = None) -> None:
        """force (k, 3) on the objects of worlds `which`, or of all."""

    def state(self) -> State:
        """What is known now."""

    def save(self) -> Any:
        """Everything that the next step depends on."""

    def restore(self, token: Any) -> State:
        """Back to that moment."""

    def close(self) -> None:
        """Give the engine back; twice is harmless."""


def batch(engine: str, scenes: Sequence[Scene], threads: int = 1, processes: int = 1, device: str = "cpu") -> Batch:
    """Worlds of an engine, on `threads` in each of `processes`. ValueError for what an engine cannot be asked: another device than
    the CPU where it has none, threads or processes where all worlds are computed together.
    """
    if engine in TOGETHER:
        if threads > 1 or processes > 1:
            raise ValueError(f"{engine}: expected one thread and one process, got {threads} and {processes}; it computes all "
                             "worlds at once")
        made: Callable[[Sequence[Scene], str], Batch] = load(TOGETHER, engine)
        return made(scenes, device)
    if device != "cpu":
        raise ValueError(f"device: expected cpu with the engine {engine}, got {device!r}; only {', '.join(TOGETHER)} has another")
    return Apart(engine, scenes, threads, processes) if processes > 1 else Worlds(engine, scenes, threads)
