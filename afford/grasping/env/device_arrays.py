"""Tensors on a device for n worlds: their states, observations, rewards and episodes (arrays.Arrays)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from afford.common.arrays import mapped, to_numpy
from afford.grasping.env.arrays import NUMPY, Arrays
from afford.grasping.sim.engine import State, World
from afford.grasping.sim.worlds import TOGETHER, DeviceBatch, WorldBatch


class DeviceArrays:
    """Tensors on a device. Numbers have 64 bits, as numpy's, since nearest points are found by differences of squares."""

    def __init__(self, device: str | torch.device) -> None:
        self.device = torch.device(device)

    def own(self, x: np.ndarray | Tensor) -> Tensor:
        """Convert an array, by a copy, or a tensor; integers and truth values keep their type."""
        found = torch.tensor(x, device=self.device) if isinstance(x, np.ndarray) else x.to(self.device)
        return found.double() if found.is_floating_point() else found

    def checked(self, action: np.ndarray | Tensor, shape: tuple[int, ...]) -> Tensor:
        """Actions as tensor. ValueError for another shape; worlds with numbers that are not finite diverge instead."""
        found = self.own(action)
        if found.shape != shape:
            raise ValueError(f"action: expected finite {shape}, got shape {tuple(found.shape)}")
        return found

    def worlds(self, batch: WorldBatch) -> WorldBatch:
        """Worlds whose commands and states are tensors."""
        return TensorWorlds(batch, self)


def arrays_of(engine: str, device: str) -> Arrays:
    """Library of worlds of an engine: tensors on their device if it computes all of them there, else numpy."""
    return DeviceArrays(device) if engine in TOGETHER else NUMPY


class TensorWorlds:
    """Worlds whose commands and states are tensors; see WorldBatch. Resets and pushes take arrays of numpy.

    Worlds of an engine that computes on a device are read and commanded there. Those of others are copied at every step.
    """

    def __init__(self, batch: WorldBatch, arrays: DeviceArrays) -> None:
        self.batch, self._arrays = batch, arrays
        self._device = batch if isinstance(batch, DeviceBatch) else None

    def single_world(self, k: int) -> World:
        """Return world k."""
        return self.batch.single_world(k)

    def reset(self, q: np.ndarray, body: np.ndarray, which: Sequence[int] | None = None) -> State:
        """Reset the worlds `which`, or all, to q (k, d) and body (k, 7)."""
        return self._owned(self.batch.reset(q, body, which))

    def step(self, u: Any, control_s: float) -> State:
        """Advance all worlds with commands u (n, m)."""
        if self._device is None:
            return self._owned(self.batch.step(to_numpy(u), control_s))
        self._device.advance(u, control_s)
        return self.state()

    def push(self, force: np.ndarray, duration_s: float, which: Sequence[int] | None = None) -> None:
        """Push the objects of the worlds `which`, or of all, with force (k, 3)."""
        self.batch.push(force, duration_s, which)

    def state(self) -> State:
        """Return the current states."""
        return self._owned(self.batch.state() if self._device is None else self._device.tensors())

    def save(self) -> Any:
        """Return a token of all that the next step depends on."""
        return self.batch.save()

    def restore(self, token: Any) -> State:
        """Restore a token."""
        return self._owned(self.batch.restore(token))

    def close(self) -> None:
        """Release the engine; closing twice is allowed."""
        self.batch.close()

    def _owned(self, state: State) -> State:
        return mapped(state, self._arrays.own)
