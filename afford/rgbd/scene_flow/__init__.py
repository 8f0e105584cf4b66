"""Scene flow backends: motion of all visible surfaces between two RGB-D frames, in space and on the image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from afford.common.registry import Own

if TYPE_CHECKING:
    import numpy as np

    from afford.rgbd.scene_flow.clip import RgbdFrame


@dataclass(frozen=True)
class Regularised:
    """Parameters of `regularised`."""

    smoothness: float = 60.0
    """weight of smoothness against data: how far motion spreads within a surface"""
    still_margin: float = 0.5
    """a motion must explain the second frame better than rest by so many standard deviations of the noise"""

    def __post_init__(self) -> None:
        if self.smoothness <= 0:
            raise ValueError(f"expected smoothness of more than 0, got {self.smoothness}")


class EstimateFlow(Protocol[Own]):
    """Interface of the backends in this folder."""

    def __call__(self, a: RgbdFrame, b: RgbdFrame, params: Own) -> tuple[np.ndarray, np.ndarray]:
        """Motion from `a` to `b`: in space (h, w, 3) float32 in m, on the image (h, w, 2) float32 in px. Never NaN.

        `params` are those of this backend. Pure and deterministic; the inputs are not modified.
        """
        ...
