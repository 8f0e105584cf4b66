"""What is wrong with depth: it scatters and comes in steps, both growing with the square of the distance, and it has holes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from afford.grasping.policies.cameras import NOTHING, Images
from afford.grasping.sim.scene import Range


@dataclass(frozen=True)
class DepthNoise:
    """Of the cameras of one world; nothing is wrong where all are 0."""

    scatter_m: float = 0.0
    """standard deviation of depth at 1 m"""
    step_m: float = 0.0
    """distance of two depths that can be told apart at 1 m: cameras measure disparity, in whole steps"""
    holes: float = 0.0
    """share of pixels that show nothing"""


RANDOM_DEPTH: Mapping[str, Range] = {
    "scatter_m": Range(0.0, 0.006),
    "step_m": Range(0.0, 0.004),
    "holes": Range(0.0, 0.05),
}
"""field of DepthNoise -> how it varies between worlds"""


def drawn(seed: int, ranges: Mapping[str, Range] = RANDOM_DEPTH) -> DepthNoise:
    """Noise of one world, from a stream of its own; the same seed gives the same."""
    rng = np.random.default_rng([seed, 2])
    return DepthNoise(**{name: ranges[name].draw(rng) for name in sorted(ranges)})


def noisy(images: Images, noise: Sequence[DepthNoise], rng: np.random.Generator) -> Images:
    """The pictures of n worlds, each with its noise (n). Nothing is drawn where nothing is wrong."""
    if all(one == DepthNoise() for one in noise):
        return images
    scatter, step, holes = (np.array([getattr(one, name) for one in noise])[:, None, None, None]
                            for name in ("scatter_m", "step_m", "holes"))  # fmt: skip
    depth = images.depth_m + scatter * images.depth_m**2 * rng.standard_normal(images.depth_m.shape)
    disparity = np.divide(1.0, depth, out=np.zeros_like(depth), where=depth > 0)
    whole = np.divide(disparity, step, out=disparity.copy(), where=step > 0)
    whole = np.where(step > 0, np.maximum(np.round(whole), 1.0) * step, disparity)
    gone = (images.kind == NOTHING) | (depth <= 0) | (rng.random(depth.shape) < holes)
    depth = np.divide(1.0, whole, out=np.zeros_like(depth), where=~gone)
    return replace(images, depth_m=depth.astype(np.float32), kind=np.where(gone, NOTHING, images.kind))
