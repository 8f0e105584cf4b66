"""Direct alignment of a template with an image: Gauss-Newton on brightness and silhouette (after Baker & Matthews 2004).

A pose is a (2, 3) matrix that maps a canvas point (u, v, 1), u and v centred and scaled to about [-1, 1], to image pixels.
"""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit

REACH_PX = 6.0


def signed_distance(inside: np.ndarray, known: np.ndarray, reach_px: float = REACH_PX) -> tuple[np.ndarray, np.ndarray]:
    """Compute the signed distance (h, w) float32 to an outline (px, inside positive, clipped at `reach_px`) and its weight.

    inside: (h, w) bool, a subset of known: (h, w) bool, the pixels whose membership is certain. The weight (h, w) float32 is 1
    where no unknown pixel is nearer than the outline, else 0, because the outline may pass through unknown pixels.
    """
    background = known & ~inside
    distance = np.where(inside, _distance_to(background), -_distance_to(inside)) - np.where(inside, 0.5, -0.5).astype(np.float32)
    distance = np.clip(distance, -reach_px, reach_px)
    return distance, (known & (_distance_to(~known) > np.abs(distance))).astype(np.float32)


def _distance_to(target: np.ndarray) -> np.ndarray:
    """Distance of every pixel to the nearest pixel of `target`; a large number for an empty target."""
    return cv2.distanceTransform((~target).view(np.uint8), cv2.DIST_L2, 3)


HUBER_GREY = 12.0
HUBER_PX = 1.5


@njit(cache=True)
def normal_equations(
    points: np.ndarray, appearance: np.ndarray, distance: np.ndarray, image: np.ndarray, outline: np.ndarray,
    pose: np.ndarray, hessian: np.ndarray, gradient: np.ndarray,
) -> tuple[float, float]:  # fmt: skip
    """Accumulate J^T W J (6, 6) and J^T W r (6,) over all canvas points; returns (robust cost, total weight).

    points: (m, 2) float32 canvas coordinates. appearance: (m, 2) float32 grey value and its weight. distance: (m, 2) float32
    signed distance to the canvas outline (px, inside positive) and its weight. image, outline: (h, w, 4) float32 of the image:
    value, its x and y derivative, and weight, for grey and for signed distance.
    """
    height, width = image.shape[0], image.shape[1]
    cost, total = 0.0, 0.0
    jacobian = np.zeros(6)
    for i in range(points.shape[0]):
        u, v = points[i, 0], points[i, 1]
        x = pose[0, 0] * u + pose[0, 1] * v + pose[0, 2]
        y = pose[1, 0] * u + pose[1, 1] * v + pose[1, 2]
        if x < 0 or y < 0 or x >= width - 1 or y >= height - 1:
            continue
        for kind in range(2):
            field = image if kind == 0 else outline
            wanted = appearance if kind == 0 else distance
            weight = wanted[i, 1]
            if weight <= 0:
                continue
            x0, y0 = int(x), int(y)
            a, b = x - x0, y - y0
            w00, w10, w01, w11 = (1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b
            p00, p10, p01, p11 = field[y0, x0], field[y0, x0 + 1], field[y0 + 1, x0], field[y0 + 1, x0 + 1]
            weight *= w00 * p00[3] + w10 * p10[3] + w01 * p01[3] + w11 * p11[3]
            if weight <= 0.01:
                continue
            value = w00 * p00[0] + w10 * p10[0] + w01 * p01[0] + w11 * p11[0]
            dx = w00 * p00[1] + w10 * p10[1] + w01 * p01[1] + w11 * p11[1]
            dy = w00 * p00[2] + w10 * p10[2] + w01 * p01[2] + w11 * p11[2]
            scale = HUBER_GREY if kind == 0 else HUBER_PX
            residual = (value - wanted[i, 0]) / scale
            size = abs(residual)
            robust = 1.0 if size <= 1.0 else 1.0 / size
            cost += weight * (0.5 * residual * residual if size <= 1.0 else size - 0.5)
            total += weight
            dx, dy = dx / scale, dy / scale
            jacobian[0], jacobian[1], jacobian[2] = dx * u, dx * v, dx
            jacobian[3], jacobian[4], jacobian[5] = dy * u, dy * v, dy
            weight *= robust
            for r in range(6):
                gradient[r] += weight * jacobian[r] * residual
                for c in range(r, 6):
                    hessian[r, c] += weight * jacobian[r] * jacobian[c]
    return cost, total


def align(
    points: np.ndarray, appearance: np.ndarray, distance: np.ndarray, image: np.ndarray, outline: np.ndarray,
    pose: np.ndarray, expected: np.ndarray, steps: int, stiffness: np.ndarray,
) -> tuple[np.ndarray, float]:  # fmt: skip
    """Refine `pose` (2, 3) by at most `steps` damped Gauss-Newton steps; returns (pose, mean robust cost per weight).

    `stiffness` (6, 6) is the weight of a prior, in samples per px^2, that keeps the pose, read row by row, near `expected` (2, 3).
    Other arguments as in `normal_equations`.
    """
    prior, best, damping = expected.ravel().astype(np.float64), pose.ravel().astype(np.float64), 1e-3
    cost, hessian, gradient = _evaluate(points, appearance, distance, image, outline, best, prior, stiffness)
    for _ in range(steps):
        step = np.linalg.solve(hessian + damping * np.diag(np.diag(hessian)) + 1e-6 * np.eye(6), gradient)
        trial = best - step
        outcome = _evaluate(points, appearance, distance, image, outline, trial, prior, stiffness)
        if outcome[0] < cost:
            best, (cost, hessian, gradient), damping = trial, outcome, damping * 0.3
            if np.abs(step).max() < 0.02:
                break
        else:
            damping *= 10
    return best.reshape(2, 3), cost


def _evaluate(
    points: np.ndarray, appearance: np.ndarray, distance: np.ndarray, image: np.ndarray, outline: np.ndarray,
    pose: np.ndarray, prior: np.ndarray, stiffness: np.ndarray,
) -> tuple[float, np.ndarray, np.ndarray]:  # fmt: skip
    hessian, gradient = np.zeros((6, 6)), np.zeros(6)
    cost, total = normal_equations(points, appearance, distance, image, outline, pose.reshape(2, 3), hessian, gradient)
    total = max(total, 1.0)
    offset = pose - prior
    prior_gradient = stiffness @ offset
    hessian = (hessian + np.triu(hessian, 1).T + stiffness) / total
    return (cost + 0.5 * float(offset @ prior_gradient)) / total, hessian, (gradient + prior_gradient) / total
