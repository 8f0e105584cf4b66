"""Mask -> VISOR polygons, and back: outlines in 1920 x 1080 that give the same mask again when VISOR's readers draw them."""

from __future__ import annotations

import cv2
import numpy as np

GRID_WH = (1920, 1080)


def trace(mask: np.ndarray) -> list[list[list[float]]]:
    """Outlines of a (h, w) bool mask: polygons of [x, y] corners in the 1920 x 1080 grid, holes as further polygons.

    The mask is blown up so that each of its pixels covers exactly the grid cells that nearest-neighbour resizing would read
    from, then every border is followed. Drawing all polygons together (even-odd, borders included) fills the same cells.
    """
    rows, columns = _cells(mask.shape[0], GRID_WH[1]), _cells(mask.shape[1], GRID_WH[0])
    large = np.ascontiguousarray(mask[rows][:, columns]).view(np.uint8)
    outlines, _ = cv2.findContours(large, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    return [outline.reshape(-1, 2).astype(float).tolist() for outline in outlines]


def draw(segments: list[list[list[float]]], width: int, height: int) -> np.ndarray:
    """The mask (height, width) bool of VISOR polygons, by VISOR's own rule: truncate, even-odd fill, nearest resize."""
    grid = np.zeros((GRID_WH[1], GRID_WH[0]), np.uint8)
    corners = [np.asarray(polygon, np.float64).reshape(-1, 2).astype(np.int32) for polygon in segments if polygon]
    if corners:
        cv2.fillPoly(grid, corners, 1)
    return cv2.resize(grid, (width, height), interpolation=cv2.INTER_NEAREST).astype(bool)


def _cells(size: int, grid: int) -> np.ndarray:
    """For each of `grid` cells the index of the pixel, of `size`, that reads it."""
    first = np.arange(size) * grid // size
    return np.searchsorted(first, np.arange(grid), side="right") - 1
