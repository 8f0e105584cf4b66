"""Look the same scene point up in many frames: the kernels that fill a hole of one frame from the others.

A scene point is a homogeneous 4-vector, a camera a (3, 4) matrix that maps it to homogeneous image pixels. A plane, or an
affine object, has points (u, v, 1, 0); the fourth entry is parallax.
"""

from __future__ import annotations

import numpy as np
from numba import njit

AGREE_GREY = 20.0


@njit(cache=True)
def gather_colour(
    points: np.ndarray, cameras: np.ndarray, rows: np.ndarray, weights: np.ndarray, rgb: np.ndarray, usable: np.ndarray,
    quantile: float,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Colour of every scene point: the mean of the samples near a weighted quantile of brightness (0.5 the median, higher
    ones avoid passing shadows).

    points (m, 4) float64; cameras (n, 3, 4) float64, rows (n,) int64 and weights (n,) float64 of the frames to look into;
    rgb (t, h, w, 3) uint8; usable (t, h, w) bool. Returns colour (m, 3) float32 and the weight (m,) float32 that was found,
    0 where no frame shows the point.
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
    """How many frames, by weight, show every scene point inside the shape, and how many show it at all: (m,), (m,) float32.

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
    """Mean of the samples (red, green, blue, grey, weight) whose grey is near that of the sample at weight `enough`."""
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
