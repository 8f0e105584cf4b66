"""Question: how much does this grasp look like a person's, from 1 to 10?"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from afford.common.registry import Own

if TYPE_CHECKING:
    import numpy as np


class Judge(Protocol[Own]):
    """What every backend of this folder looks like."""

    def __call__(self, name: str, frames: np.ndarray, seconds: np.ndarray, params: Own) -> float:
        """1..10 for the frames (t, h, w, 3) uint8 of the episode `name`, taken at times (t,). `params` are those of this backend.
        ValueError in one sentence when there is no judgement: no model, no server, an answer without a number.
        """
