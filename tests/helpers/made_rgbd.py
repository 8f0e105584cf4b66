"""RGB-D frames of textured planes that move as rigid bodies, with the exact motion of every pixel; ray-cast here."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

SIZE = 112
K = np.array([[120.0, 0, 55.5], [0, 120.0, 55.5], [0, 0, 1]])


@dataclass(frozen=True)
class Plate:
    """A textured rectangle that moves at constant velocity and turns about its centre."""

    centre_m: tuple[float, float, float]
    half_m: tuple[float, float]
    velocity_m: tuple[float, float, float]
    turn_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    seed: int = 0

    def pose(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Rotation (3, 3) and centre (3,) at frame t."""
        turned = Rotation.from_rotvec(np.array(self.turn_rad) * t).as_matrix()
        return turned, np.array(self.centre_m) + t * np.array(self.velocity_m)

    def texture(self) -> np.ndarray:
        rng = np.random.default_rng(self.seed)
        coarse = rng.integers(30, 225, (9, 9, 3)).astype(np.uint8)
        fine = cv2.resize(rng.integers(0, 40, (32, 32, 3)).astype(np.uint8), (256, 256), interpolation=cv2.INTER_LINEAR)
        return cv2.add(cv2.resize(coarse, (256, 256), interpolation=cv2.INTER_CUBIC), fine)


TABLE = Plate((0, 0, 1.0), (2.0, 2.0), (0, 0, 0), seed=9)
SCENE = (TABLE, Plate((-0.12, -0.1, 0.8), (0.12, 0.1), (0.012, 0.004, -0.01), seed=1),
         Plate((0.16, 0.12, 0.85), (0.1, 0.12), (-0.004, 0.0, 0.012), (0.0, 0.03, 0.08), seed=2))  # fmt: skip


def rays(size: int) -> np.ndarray:
    y, x = np.mgrid[:size, :size].astype(np.float64)
    k = intrinsics(size)
    return np.dstack([(x - k[0, 2]) / k[0, 0], (y - k[1, 2]) / k[1, 1], np.ones_like(x)])


def intrinsics(size: int) -> np.ndarray:
    scale = size / SIZE
    out = K * scale
    out[:2, 2] = (size - 1) / 2
    out[2, 2] = 1
    return out


def exact(plates: tuple[Plate, ...], t: float, size: int = SIZE) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """rgb (h, w, 3) uint8, depth (h, w) m, motion until frame t + 1 (h, w, 3) m."""
    ray = rays(size)
    depth = np.full((size, size), np.inf)
    rgb, motion = np.zeros((size, size, 3), np.uint8), np.zeros((size, size, 3))
    for plate in plates:
        (turned, centre), (then, later) = plate.pose(t), plate.pose(t + 1)
        normal = turned[:, 2]
        z = (centre @ normal) / (ray @ normal)
        local = (ray * z[..., None] - centre) @ turned
        hit = (np.abs(local[..., :2]) <= plate.half_m).all(-1) & (z < depth) & (z > 0)
        at = ((local[..., :2] / plate.half_m + 1) * 127.5).astype(np.float32)
        rgb[hit] = cv2.remap(plate.texture(), at[..., 0].copy(), at[..., 1].copy(), cv2.INTER_LINEAR)[hit]
        depth[hit] = z[hit]
        motion[hit] = (local @ then.T + later - ray * z[..., None])[hit]
    return rgb, depth, motion


def sensed(rgb: np.ndarray, depth: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Noise, millimetres and holes as a Kinect has them."""
    rng = np.random.default_rng(seed)
    noisy = depth + rng.normal(0, 0.0012 + 0.0019 * (depth - 0.4) ** 2)
    edge = cv2.dilate((np.abs(cv2.Laplacian(depth, cv2.CV_64F)) > 0.05).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    holes = (edge & (rng.random(depth.shape) < 0.7)) | (cv2.resize(rng.random((14, 14)), depth.shape[::-1]) > 0.93)
    grains = rng.normal(0, 2.0, rgb.shape)
    return (np.clip(rgb + grains, 0, 255).round().astype(np.uint8),
            np.where(holes, 0, np.round(noisy, 3)).astype(np.float32))  # fmt: skip


def clip(plates: tuple[Plate, ...] = SCENE, frames: int = 4, size: int = SIZE, seed: int = 0) -> tuple[np.ndarray, ...]:
    """rgb (t, h, w, 3) uint8 and depth (t, h, w) float32 as a sensor sees them, exact motion (t - 1, h, w, 3) m."""
    made = [exact(plates, t, size) for t in range(frames)]
    seen = [sensed(rgb, depth, seed * 1000 + n) for n, (rgb, depth, _) in enumerate(made)]
    return (np.stack([rgb for rgb, _ in seen]), np.stack([depth for _, depth in seen]),
            np.stack([motion for *_, motion in made[:-1]]))  # fmt: skip
