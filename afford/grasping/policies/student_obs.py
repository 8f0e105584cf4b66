"""Observation of the student: a point cloud of hand and object from depth images, N_t, and the robot's own numbers.

`student_obs` alone computes it, from depth images, proprioception and N_t: no privileged state of the object passes through.
Clouds are relative to the middle of the palm, along the axes of the start (proprioception.py). Hand and object have equally many
points, so that the large hand does not crowd out the object.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from afford.common.geometry import farthest_point_sampling
from afford.grasping.env.scenery import to_frame
from afford.grasping.policies.depth_cameras import HAND, OBJECT, DepthImages, unproject
from afford.grasping.policies.proprioception import Proprioception, RobotBody, StartFrame
from afford.render.scene import Camera

LOW_M, HIGH_M = (-1.0, -1.0, 0.002), (1.0, 1.0, 0.7)
"""box of the world that clouds are cropped to (the paper crops at 1 cm above the table; knives are thinner)"""
SAMPLINGS = ("even", "farthest")


@dataclass(frozen=True)
class CloudSampling:
    """Sampling of point clouds from depth images. ValueError for an unknown value."""

    points: int = 512
    """points of a cloud; half of them are of the hand"""
    sampling: str = "even"
    """even: pixels at even intervals; farthest: farthest point sampling, the paper's, slow"""
    layout: str = "small"
    """layout of the robot's own numbers (obs_blocks.py)"""

    def __post_init__(self) -> None:
        if self.points < 2 or self.points % 2:
            raise ValueError(f"points: expected an even number of 2 or more, got {self.points}")
        if self.sampling not in SAMPLINGS:
            raise ValueError(f"sampling: expected {' or '.join(SAMPLINGS)}, got {self.sampling!r}")


PAPER = CloudSampling(1024, "farthest", "paper")
"""sampling of AffordDex"""


class StudentObs(NamedTuple):
    """Observations of n students."""

    robot: np.ndarray
    """(n, r) float32: blocks R; then 1 or 0 for visible points of the hand, visible points of the object, and points of N_t"""
    cloud: np.ndarray
    """(n, k, 3) float16 m: first half hand, second half object; 0 where no point is visible"""
    N: np.ndarray
    """(n, 100, 3) float16 m: negative points; 0 where there are none"""


def student_obs(images: DepthImages, own: Proprioception, N_t: np.ndarray, any_N: np.ndarray, cameras: Sequence[Camera],
                body: RobotBody, start: StartFrame, eyes: CloudSampling) -> StudentObs:  # fmt: skip
    """Compute observations from depth images (n, c, h, w), the robots' own senses, and N_t (n, 100, 3) in the world.

    `any_N` (n,) is false for tasks without negative points. `cameras`, `body`, `start` and `eyes` are constants of the setup.
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
    return StudentObs(robot.astype(np.float32), local.astype(np.float16), N.astype(np.float16))


def _points(cameras: Sequence[Camera], depth_m: np.ndarray, shown: np.ndarray, eyes: CloudSampling) -> np.ndarray:
    """(k, 3) world points of a sample of the pixels `shown` (c, h, w); empty without such pixels."""
    pixels, half = np.flatnonzero(shown), eyes.points // 2
    if eyes.sampling == "even":
        return _inside(unproject(cameras, depth_m, pixels[(np.arange(half) * len(pixels)) // half] if len(pixels) else pixels))
    found = _inside(unproject(cameras, depth_m, pixels))
    return found[farthest_point_sampling(found, half)]


def _inside(points: np.ndarray) -> np.ndarray:
    found: np.ndarray = points[((points >= LOW_M) & (points <= HIGH_M)).all(axis=1)]
    return found


def _filled(points: np.ndarray, count: int) -> np.ndarray:
    """(count, 3) points, repeated from the first when there are fewer."""
    return points[np.arange(count) % len(points)] if len(points) else np.zeros((count, 3))
