"""Library in which n worlds compute observations and rewards: numpy on the CPU, or torch on a device (device_arrays.py).

Formulas are written once for both (afford/common/arrays.py); this interface is what differs: where constants and the progress of
episodes are, how actions are checked, and how states come from the engine.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from afford.grasping.env import actions
from afford.grasping.sim.worlds import WorldBatch


class Arrays(Protocol):
    """Library of arrays of n worlds."""

    def own(self, x: Any) -> Any:
        """Convert an array of numpy: numbers, integers or truth values."""

    def checked(self, action: Any, shape: tuple[int, ...]) -> Any:
        """Actions as numbers of the library. ValueError for another shape."""

    def worlds(self, batch: WorldBatch) -> WorldBatch:
        """Worlds whose commands and states are arrays of the library."""


class NumpyArrays:
    """Arrays of numpy, on the CPU, in 64 bits."""

    def own(self, x: np.ndarray) -> np.ndarray:
        """Return the array."""
        return x

    def checked(self, action: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
        """Actions as float64. ValueError for another shape, or numbers that are not finite."""
        return actions.checked(action, shape)

    def worlds(self, batch: WorldBatch) -> WorldBatch:
        """Return the worlds."""
        return batch


NUMPY = NumpyArrays()
