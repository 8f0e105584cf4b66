"""What the student sees: a cloud of hand and object from depth, N_t, and the robot's own numbers. `see` is the only door to it, and
it takes nothing but pictures, proprioception and N_t.

Clouds are from the middle of the palm, along the axes of the start (proprioception.py). Every kind has as many points as the other,
so that the hand, which is large, does not crowd out the object.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from afford.common.geometry import farthest_point_sampling
from afford.grasping.env.scenery import to_frame
from afford.grasping.policies.cameras import HAND, OBJECT, Images, spots
from afford.grasping.policies.proprioception import Body, Proprioception, Start
from afford.render.scene import Camera

LOW_M, HIGH_M = (-1.0, -1.0, 0.002), (1.0, 1.0, 0.7)
"""what is outside this box of the world is not looked at (the paper cuts off 1 cm above the table: knives are thinner)"""
SAMPLINGS = ("even", "farthest")


@dataclass(frozen=True)
class Eyes:
    """How clouds are made of pictures. ValueError for what cannot be."""

    points: int = 512
    """of a cloud, half of them of the hand"""
    sampling: str = "even"
    """even: every so many pixels; farthest: the points that are farthest apart, the paper's, slow"""
    layout: str = "small"
    """of the robot's own numbers (observe.py)"""

    def __post_init__(self) -> None:
        if self.points < 2 or self.points % 2:
            raise ValueError(f"Eyes.points: expected an even number of 2 or more, got {self.points}")
        if self.sampling not in SAMPLINGS:
            raise ValueError(f"Eyes.sampling: expected {' or '.join(SAMPLINGS)}, got {self.sampling!r}")


PAPER = Eyes(1024, "farthest", "paper")
"""as AffordDex has it"""


class Seen(NamedTuple):
    """What n students see."""

    robot: np.ndarray
    """(n, r) float32: blocks R; then whether a point of the hand, of the object, and of N_t is there"""
    cloud: np.ndarray
    """(n, k, 3) float16 m: first half hand, second half object; 0 where none is seen"""
    N: np.ndarray
    """(n, 100, 3) float16 m: negative points; 0 where there are none"""


def see(images: Images, own: Proprioception, N_t: np.ndarray, any_N: np.ndarray, cameras: Sequence[Camera], body: Body,
        start: Start, eyes: Eyes) -> Seen:  # fmt: skip
    """Pictures (n, c, h, w), the robots' own senses, and N_t (n, 100, 3) in the world where any_N (n,) says that there is one.
    `cameras`, `body`, `start` and `eyes` are known beforehand.
    """
    clouds = [[_points(cameras, depth, kind == wanted, eyes) for wanted in (HAND, OBJECT)]
              for depth, kind in zip(images.depth_m, images.kind, strict=True)]  # fmt: skip
    there = np.array([[len(found) > 0 for found in both] for both in clouds])
    cloud = np.stack([np.concatenate([_filled(found, eyes.points // 2) for found in both]) for both in clouds])
    middle = body.palm(own.q)[1][:, None]
    known = np.repeat(there, eyes.points // 2, axis=1)[..., None]
    local = np.where(known, to_frame(cloud - middle, start.yaw), 0.0)
    N = np.where(any_N[:, None, None], to_frame(N_t - middle, start.yaw), 0.0)
    robot = np.concatenate([body.numbers(eyes.layout, own, start), there, any_N[:, None]], axis=1)
    return Seen(robot.astype(np.float32), local.astype(np.float16), N.astype(np.float16))


def _points(cameras: Sequence[Camera], depth_m: np.ndarray, shown: np.ndarray, eyes: Eyes) -> np.ndarray:
    """(k, 3) places of some of the pixels `shown` (c, h, w), or of none, in the world."""
    pixels, half = np.flatnonzero(shown), eyes.points // 2
    if eyes.sampling == "even":
        return _inside(spots(cameras, depth_m, pixels[(np.arange(half) * len(pixels)) // half] if len(pixels) else pixels))
    found = _inside(spots(cameras, depth_m, pixels))
    return found[farthest_point_sampling(found, half)]


def _inside(points: np.ndarray) -> np.ndarray:
    found: np.ndarray = points[((points >= LOW_M) & (points <= HIGH_M)).all(axis=1)]
    return found


def _filled(points: np.ndarray, count: int) -> np.ndarray:
    """(count, 3): the points, again from the first when there are fewer."""
    return points[np.arange(count) % len(points)] if len(points) else np.zeros((count, 3))
