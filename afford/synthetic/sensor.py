"""Sensor models: depth camera noise that grows with the square of the distance, quantization and holes; colour sensor noise."""

from __future__ import annotations

import cv2
import numpy as np

STEP_M = 0.001
"""Quantization step of depth, metres."""
GRAZING = 0.17
"""Cosine of the angle between normal and ray below which little light returns (80 degrees)."""
SPECKLE = 0.62
"""Level of blurred noise above which a small patch is missing."""
JUMP_M = 0.015
"""Bend of a surface within a pixel above which it counts as two surfaces, metres (inverse depth is linear on planes)."""


def measure_depth(depth_m: np.ndarray, K: np.ndarray, noise: float, rng: np.random.Generator) -> np.ndarray:
    """Simulate the depth (h, w) float32 of a depth camera, 0 for a hole. `noise` scales all noise; 0 leaves the quantization.

    Axial noise of 1.2 mm + 1.9 mm (z - 0.4)^2, z in metres, and lateral noise follow Nguyen, Izadi and Lovell 2012 (Kinect).
    """
    if noise <= 0:
        return quantize_depth(depth_m)
    height, width = depth_m.shape
    around = noise * 0.4 * rng.standard_normal((2, height, width)).astype(np.float32)
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    seen = cv2.remap(depth_m, x + around[0], y + around[1], cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
    sigma = noise * (0.0012 + 0.0019 * (seen - 0.4) ** 2)
    seen = np.where(seen > 0, seen + sigma * rng.standard_normal(seen.shape).astype(np.float32), 0)
    return quantize_depth(np.where(depth_holes(depth_m, K, noise, rng), 0, seen))


def quantize_depth(depth_m: np.ndarray) -> np.ndarray:
    """Round depth to whole millimetres, (h, w) float32."""
    return (np.round(np.maximum(depth_m, 0) / STEP_M).astype(np.uint16) * np.float64(STEP_M)).astype(np.float32)


def depth_holes(depth_m: np.ndarray, K: np.ndarray, noise: float, rng: np.random.Generator) -> np.ndarray:
    """Mark pixels without a return, (h, w) bool: at depth edges (mixed pixels), at grazing angles, and a few random patches."""
    ring = np.ones((3, 3), np.uint8)
    inverse = 1.0 / np.maximum(depth_m, 0.05)
    jump = cv2.dilate(np.abs(cv2.Laplacian(inverse, cv2.CV_32F, borderType=cv2.BORDER_REPLICATE)) * depth_m**2, ring) > JUMP_M
    chance = rng.random(depth_m.shape)
    edge = jump & (chance < 0.5 * min(noise, 1.5))
    grazing = (cos_incidence(depth_m, K) < GRAZING) & ~jump & (chance < 0.8)
    patches = cv2.GaussianBlur(rng.standard_normal(depth_m.shape), (0, 0), 1.5)
    return np.asarray(edge | grazing | (patches > SPECKLE / noise ** 0.25) | (depth_m <= 0))


def cos_incidence(depth_m: np.ndarray, K: np.ndarray) -> np.ndarray:
    """Compute the cosine (h, w) of the angle between surface normal and camera ray from depth differences."""
    height, width = depth_m.shape
    y, x = np.mgrid[0:height, 0:width]
    points = np.stack([(x - K[0, 2]) / K[0, 0], (y - K[1, 2]) / K[1, 1], np.ones_like(x)], -1) * depth_m[..., None]
    normal = np.cross(np.gradient(points, axis=1), np.gradient(points, axis=0))
    length = np.linalg.norm(normal, axis=-1) * np.linalg.norm(points, axis=-1)
    return np.asarray(np.abs((normal * points).sum(-1)) / np.maximum(length, 1e-12))


def add_image_noise(image: np.ndarray, rng: np.random.Generator, dark: float = 1.6, bright: float = 3.2) -> np.ndarray:
    """Add the noise of a colour sensor to an image, (h, w, 3) uint8.

    The standard deviation grows linearly from `dark` at black to `bright` at white, in grey levels. The noise is mostly grey.
    """
    level = image.astype(np.float32)
    sigma = dark + (bright - dark) * level / 255
    grey = rng.standard_normal(image.shape[:2], np.float32)[..., None]
    colour = rng.standard_normal(image.shape, np.float32)
    return np.clip(np.round(level + sigma * (0.8 * grey + 0.6 * colour)), 0, 255).astype(np.uint8)
