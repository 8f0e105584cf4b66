"""Appearance of hidden pixels: colours gathered from other frames, and relighting to match the surroundings.

A scene point is a homogeneous 4-vector, a camera a (3, 4) matrix that maps it to homogeneous image pixels. A plane, or an
affine object, has points (u, v, 1, 0); the fourth entry is parallax.
"""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit

AGREE_GREY = 20.0


@njit(cache=True)
def gather_colour(
    points: np.ndarray, cameras: np.ndarray, rows: np.ndarray, weights: np.ndarray, rgb: np.ndarray, usable: np.ndarray,
    quantile: float,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Gather the colour of every scene point: the mean of the samples near a weighted quantile of brightness.

    quantile: 0.5 is the median; larger values avoid passing shadows. points (m, 4) float64; cameras (n, 3, 4) float64, rows (n,)
    int64 and weights (n,) float64 of the source frames; rgb (t, h, w, 3) uint8; usable (t, h, w) bool. Returns colour (m, 3)
    float32 and the total weight (m,) float32 of the samples, 0 where no frame shows the point.
    """
    height, width = usable.shape[1], usable.shape[2]
    colour, found = np.zeros((points.shape[0], 3), np.float32), np.zeros(points.shape[0], np.float32)
    samples, order = np.zeros((cameras.shape[0], 5)), np.zeros(cameras.shape[0], np.int64)
    for i in range(points.shape[0]):
        count = 0
        for k in range(cameras.shape[0]):
            x, y = _project(cameras[k], points[i])
            if not (0 <= x < width - 1 and 0 <= y < height - 1):
                continue
            t, x0, y0 = rows[k], int(x), int(y)
            if not (usable[t, y0, x0] and usable[t, y0 + 1, x0 + 1] and usable[t, y0, x0 + 1] and usable[t, y0 + 1, x0]):
                continue
            a, b = x - x0, y - y0
            for c in range(3):
                top = (1 - a) * rgb[t, y0, x0, c] + a * rgb[t, y0, x0 + 1, c]
                low = (1 - a) * rgb[t, y0 + 1, x0, c] + a * rgb[t, y0 + 1, x0 + 1, c]
                samples[count, c] = (1 - b) * top + b * low
            samples[count, 3] = (samples[count, 0] + samples[count, 1] + samples[count, 2]) / 3
            samples[count, 4] = weights[k]
            found[i] += weights[k]
            count += 1
        if count > 0:
            _robust_mean(samples, count, found[i] * quantile, order, colour[i])
    return colour, found


@njit(cache=True)
def gather_votes(
    points: np.ndarray, cameras: np.ndarray, rows: np.ndarray, weights: np.ndarray, inside: np.ndarray, known: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Count, by weight, the frames that show every scene point inside the shape, and that show it at all: (m,), (m,) float32.

    inside, known: (t, h, w) bool; other arguments as in `gather_colour`. Nearest pixel.
    """
    height, width = known.shape[1], known.shape[2]
    yes, seen = np.zeros(points.shape[0], np.float32), np.zeros(points.shape[0], np.float32)
    for i in range(points.shape[0]):
        for k in range(cameras.shape[0]):
            x, y = _project(cameras[k], points[i])
            if not (-0.5 <= x < width - 0.5 and -0.5 <= y < height - 0.5):
                continue
            t, x0, y0 = rows[k], int(x + 0.5), int(y + 0.5)
            if known[t, y0, x0]:
                seen[i] += weights[k]
                yes[i] += weights[k] * inside[t, y0, x0]
    return yes, seen


@njit(cache=True)
def _project(camera: np.ndarray, point: np.ndarray) -> tuple[float, float]:
    x = camera[0, 0] * point[0] + camera[0, 1] * point[1] + camera[0, 2] * point[2] + camera[0, 3] * point[3]
    y = camera[1, 0] * point[0] + camera[1, 1] * point[1] + camera[1, 2] * point[2] + camera[1, 3] * point[3]
    z = camera[2, 0] * point[0] + camera[2, 1] * point[1] + camera[2, 2] * point[2] + camera[2, 3] * point[3]
    if z <= 1e-9:
        return -1e9, -1e9
    return x / z, y / z


@njit(cache=True)
def _robust_mean(samples: np.ndarray, count: int, enough: float, order: np.ndarray, out: np.ndarray) -> None:
    """Average the samples (red, green, blue, grey, weight) whose grey is near the weighted quantile at weight `enough`."""
    for k in range(count):
        place = k
        while place > 0 and samples[order[place - 1], 3] > samples[k, 3]:
            order[place] = order[place - 1]
            place -= 1
        order[place] = k
    running, middle = 0.0, samples[order[0], 3]
    for k in range(count):
        running += samples[order[k], 4]
        middle = samples[order[k], 3]
        if running >= enough:
            break
    total, red, green, blue = 0.0, 0.0, 0.0, 0.0
    for k in range(count):
        if abs(samples[k, 3] - middle) <= AGREE_GREY:
            weight = samples[k, 4]
            total += weight
            red += weight * samples[k, 0]
            green += weight * samples[k, 1]
            blue += weight * samples[k, 2]
    out[0], out[1], out[2] = red / total, green / total, blue / total


MAX_LOG = 0.9
MAX_HUE = 0.12
"""disagreement of the channels on the log ratio at which the weight of a rim pixel halves: it shows another surface, not light"""
OFFSET = 4.0
"""added to grey values, 0..255, before ratios are taken"""
SMOOTH_PX = 1.0
CONTACT_SHADE, CONTACT_SHADE_PX = 0.15, 10.0
"""darkening (log ratio) of an object deep under the hand that holds it, and the depth scale of the darkening"""


def harmonic_fill(values: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Interpolate `values` smoothly from pixels of positive `weight` (h, w): pull-push over a pyramid, (h, w) float32."""
    weight = weight.astype(np.float32)
    levels = [(values.astype(np.float32) * weight, weight)]
    while min(levels[-1][0].shape) > 2:
        levels.append((cv2.pyrDown(levels[-1][0]), cv2.pyrDown(levels[-1][1])))
    surface = levels[-1][0] / np.maximum(levels[-1][1], 1e-6)
    for total, mass in reversed(levels[:-1]):
        coarse = cv2.pyrUp(surface, dstsize=mass.shape[::-1])
        known = np.minimum(mass * 4, 1)
        surface = known * (total / np.maximum(mass, 1e-6)) + (1 - known) * coarse
    return surface


def log_ratio(image: np.ndarray, fill: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Log ratio log(image / fill) of (h, w, 3) images, (h, w) float32, and its weight (h, w) float32 in 0..1.

    weight: (h, w) bool, pixels that are compared. The weight of the ratio falls where the channels disagree, because light changes
    them together.
    """
    mass = weight.astype(np.float32)
    share = np.maximum(cv2.GaussianBlur(mass, (0, 0), SMOOTH_PX), 1e-3)[..., None]
    soft = [cv2.GaussianBlur(part.astype(np.float32) * mass[..., None], (0, 0), SMOOTH_PX) / share for part in (image, fill)]
    ratio = np.log((soft[0] + OFFSET) / (soft[1] + OFFSET))
    hue = np.abs(ratio - ratio.mean(axis=2, keepdims=True)).max(axis=2)
    return np.clip(ratio.mean(axis=2), -MAX_LOG, MAX_LOG), mass / (1 + (hue / MAX_HUE) ** 4)


def relight(fill: np.ndarray, image: np.ndarray, rim: np.ndarray) -> np.ndarray:
    """Scale `fill` (h, w, 3) float32 to agree with `image` (h, w, 3) on the `rim` (h, w) bool, smoothly in between."""
    return fill * np.exp(harmonic_fill(*log_ratio(image, fill, rim)))[..., None] if rim.any() else fill


def contact_shadow(hole: np.ndarray) -> np.ndarray:
    """Darkening factor (h, w) float32: 1 at the border of the `hole` (h, w) bool and smaller inside it.

    A hand that grasps an object shades it, which the rim around the hand does not show.
    """
    depth_px = cv2.distanceTransform(hole.view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    shade: np.ndarray = np.exp(-CONTACT_SHADE * (1 - np.exp(-depth_px / CONTACT_SHADE_PX)))
    return shade
