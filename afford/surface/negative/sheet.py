"""What was found, as pictures: an object in six views, red where a hand must not go for its first task."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from schemas.mesh import ObjectViews
from schemas.surface import NegativeAffordances

SIDE, QUALITY = 168, 82
NEGATIVE, FREE = np.array([214, 48, 39], np.float32), np.array([60, 160, 90], np.float32)
"""red where a hand must not go, green where it may"""
OPACITY = 0.55


def sheet_row(views: ObjectViews, found: NegativeAffordances, title: Sequence[str]) -> np.ndarray:
    """(SIDE, 7 * SIDE, 3) uint8: six views coloured by probability, then the one that shows most in its own colours."""
    most = int((views.face[:6] >= 0).sum((1, 2)).argmax())
    tiles = [shrink_tile(paint_view(views, n, found.tasks[0].probability)) for n in range(6)] + [shrink_tile(views.rgb[most])]
    for tile, text in zip(tiles, title, strict=False):
        draw_caption(tile, text)
    return np.concatenate(tiles, axis=1)


def paint_view(views: ObjectViews, view: int, probability: np.ndarray) -> np.ndarray:
    """(h, w, 3) uint8: a view, its faces red as far as they are negative, green as far as not."""
    p = np.append(probability, 0)[views.face[view]][..., None]
    colour = p * NEGATIVE + (1 - p) * FREE
    grey = views.rgb[view].mean(-1, keepdims=True)
    mixed = (1 - OPACITY) * grey + OPACITY * colour
    return np.where(views.face[view][..., None] >= 0, mixed, views.rgb[view]).astype(np.uint8)


def shrink_tile(picture: np.ndarray) -> np.ndarray:
    """At the size of a tile."""
    return np.ascontiguousarray(cv2.resize(picture, (SIDE, SIDE), interpolation=cv2.INTER_AREA))


def draw_caption(tile: np.ndarray, text: str) -> None:
    """A line at the foot of a tile."""
    at = (4, tile.shape[0] - 6)
    cv2.putText(tile, text.encode("ascii", "replace").decode(), at, cv2.FONT_HERSHEY_SIMPLEX, 0.36, (20, 20, 20), 1, cv2.LINE_AA)
