"""The first views of an object on one sheet, each with its name: a picture for whoever can read one picture only."""

from __future__ import annotations

import cv2
import numpy as np

from schemas.mesh import ObjectViews

COLUMNS = 3
PAPER = 235
"""grey of the sheet"""
LINE_PX = 24
"""height of the line above each picture"""


def labels(views: ObjectViews, count: int) -> tuple[str, ...]:
    """Names of the views on the sheet, row by row."""
    return views.views[:count]


def contact_sheet(views: ObjectViews, count: int) -> np.ndarray:
    """(h, w, 3) uint8: the first `count` views or as many as there are, three in a row, each under its name."""
    tiles = [_titled(picture, name) for picture, name in zip(views.rgb[:count], labels(views, count), strict=True)]
    columns = min(COLUMNS, len(tiles))
    tiles += [np.full_like(tiles[0], PAPER)] * (-len(tiles) % columns)
    rows = [np.concatenate(tiles[at : at + columns], axis=1) for at in range(0, len(tiles), columns)]
    return np.concatenate(rows, axis=0)


def _titled(picture: np.ndarray, name: str) -> np.ndarray:
    line = np.full((LINE_PX, *picture.shape[1:]), PAPER, np.uint8)
    cv2.putText(line, name, (6, LINE_PX - 8), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (20, 20, 20), 1, cv2.LINE_AA)
    return np.concatenate([line, picture], axis=0)
