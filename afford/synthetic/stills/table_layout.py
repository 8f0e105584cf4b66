"""Collision-free placement of objects on the table, and the height map of a layout."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from afford.render.motion import Pose, axis_angle, pose
from afford.synthetic.assets.object_model import ObjectModel

LOW, HIGH = np.array([-0.45, -0.10]), np.array([0.45, 0.74])
"""Corners of the height map, world x and y in metres."""
CELL_M = 0.005
WITHIN = ((-0.27, 0.27), (0.15, 0.46))
"""Range of an object's position: within reach of both hands and in view."""
GAP_M = 0.015
TRIES = 60
ANY_YAW_KINDS = ("mug",)
"""Kinds that are placed with any yaw, although the yaw matters for the hand."""
TURN_RAD = 0.7


@dataclass(frozen=True, eq=False)
class PlacedObject:
    """Object with its pose on the table; `number` identifies it within the layout."""

    number: int
    model: ObjectModel
    T_world_obj: Pose
    outline: np.ndarray
    """(n, 2) convex footprint, world x, y in metres"""

    @property
    def top_m(self) -> float:
        """Height of its highest point, metres."""
        return float(self.model.points[:, 2].max())


def place_on_table(models: Sequence[ObjectModel], rng: np.random.Generator) -> list[PlacedObject]:
    """Place models on the table, large ones first. A model without a free position in `TRIES` attempts is left out."""
    taken = np.zeros(_shape(), np.uint8)
    out: list[PlacedObject] = []
    for model in sorted(models, key=lambda m: -float(m.size[0] * m.size[1])):
        for _ in range(TRIES):
            T = pose((*(rng.uniform(*span) for span in WITHIN), 0.0), axis_angle((0, 0, 1), _yaw(model, rng)))
            placed = PlacedObject(len(out), model, T, _outline(model, T))
            mine = _rasterize(placed.outline, GAP_M)
            if not (taken & mine).any():
                taken |= mine
                out.append(placed)
                break
    return out


def height_map(objects: Sequence[PlacedObject]) -> np.ndarray:
    """Compute the height map (rows, columns) float32 of a layout, metres, 0 for the bare table."""
    out = np.zeros(_shape(), np.float32)
    for obj in objects:
        out[_rasterize(obj.outline, 0.0) > 0] = obj.top_m
    return out


def height_at(built: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Look up the height (n,) of the map under world points (n, 3); 0 outside the map."""
    column, row = np.floor((points[:, :2] - LOW) / CELL_M).astype(int).T
    inside = (column >= 0) & (row >= 0) & (column < built.shape[1]) & (row < built.shape[0])
    return np.where(inside, built[np.where(inside, row, 0), np.where(inside, column, 0)], 0.0)


def _yaw(model: ObjectModel, rng: np.random.Generator) -> float:
    if model.spins or model.kind in ANY_YAW_KINDS:
        return float(rng.uniform(-np.pi, np.pi))
    return float(np.clip(rng.normal(0.0, TURN_RAD), -2.0, 2.0))


def _outline(model: ObjectModel, T: Pose) -> np.ndarray:
    points = (model.points @ T[:3, :3].T + T[:3, 3])[:, :2].astype(np.float32)
    return cv2.convexHull(points)[:, 0]


def _rasterize(outline: np.ndarray, grown_m: float) -> np.ndarray:
    """Rasterize an outline that is first dilated by `grown_m`; (rows, columns) uint8, 1 inside."""
    out = np.zeros(_shape(), np.uint8)
    cv2.fillConvexPoly(out, np.round((outline - LOW) / CELL_M).astype(np.int32), 1)
    side = 2 * round(grown_m / CELL_M) + 1
    return cv2.dilate(out, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))) if side > 1 else out


def _shape() -> tuple[int, int]:
    columns, rows = np.round((HIGH - LOW) / CELL_M).astype(int)
    return int(rows), int(columns)
