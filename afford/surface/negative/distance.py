"""How far a place is from the negative points: exact, and as a grid for planners and rewards that run elsewhere."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.spatial import cKDTree

from schemas.surface import DistanceField


def distance_to_points(N_t: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(n,) float64 metres from each point (n, 3) to the nearest negative point (k, 3); infinite when there is none."""
    return np.asarray(cKDTree(N_t).query(points)[0]) if len(N_t) else np.full(len(points), np.inf)


def distance_field(name: str, N_t: np.ndarray, vertices: np.ndarray, spacing_m: float, margin_m: float) -> DistanceField:
    """Distances on a grid around the object (v, 3) and `margin_m` beyond it."""
    low, high = vertices.min(0) - margin_m, vertices.max(0) + margin_m
    count = np.ceil((high - low) / spacing_m).astype(int) + 1
    axes = [low[k] + spacing_m * np.arange(count[k]) for k in range(3)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    return DistanceField(name, distance_to_points(N_t, nodes).reshape(count).astype(np.float32), low.astype(np.float64), spacing_m)


def interpolate_field(grid: DistanceField, points: np.ndarray) -> np.ndarray:
    """(n,) float32 metres, between the nodes linearly; beyond the grid never less than the distance to it.

    Off by at most sqrt(3) times the spacing inside.
    """
    where = (points - grid.origin) / grid.spacing_m
    inside = where.clip(0, np.array(grid.distance_m.shape) - 1)
    beyond = np.linalg.norm((where - inside) * grid.spacing_m, axis=1)
    found = map_coordinates(grid.distance_m, inside.T, order=1, mode="nearest")
    return np.maximum(found, beyond).astype(np.float32)
