"""Overlapping square windows over the silhouette of each of the six cardinal views, without segmentation.

Baselines score the windows with models that classify images but propose no masks.
"""

from __future__ import annotations

import numpy as np

from afford.common.masks import box
from afford.render.views.plan import SIX
from afford.surface.proposals import Windows
from afford.surface.proposals.nms import collect_candidates
from schemas.mesh import ObjectMesh, ObjectViews
from schemas.surface import PartCandidates

UNKNOWN = 0.5
"""quality of every window"""


def propose(mesh: ObjectMesh, views: ObjectViews, params: Windows) -> PartCandidates:
    """Propose windows row by row, cut with the silhouette (`Propose`); equal windows are merged."""
    found: list[tuple[int, np.ndarray, float]] = []
    for view, face in enumerate(views.face[:SIX]):
        least = max(params.least_window * (face >= 0).sum(), 1)
        distinct = {mask.tobytes(): mask for mask in windows(face >= 0, params.windows)}.values()
        found += [(view, mask, UNKNOWN) for mask in distinct if mask.sum() >= least]
    return collect_candidates(mesh.name, found, views.face.shape[1:])


def windows(on: np.ndarray, count: int) -> np.ndarray:
    """Return (count ** 2, h, w) bool: squares that overlap by half and cover a silhouette (h, w) bool.

    The squares together cover the square around the silhouette, and each is cut with it. Raises ValueError for a count below 1.
    """
    if count < 1:
        raise ValueError(f"mask_propose.grid.windows: expected 1 or more along a side, got {count}")
    rows, columns = (_bands(side, max(s.stop - s.start for s in box(on)), length, count)
                     for side, length in zip(box(on), on.shape, strict=True))  # fmt: skip
    return (rows[:, None, :, None] & columns[None, :, None, :]).reshape(-1, *on.shape) & on


def _bands(side: slice, width: int, length: int, count: int) -> np.ndarray:
    """Return (count, length) bool: intervals that overlap by half and cover `width` px around the centre of `side`."""
    step = width / (count + 1)
    start = (side.start + side.stop - width) / 2 + step * np.arange(count)[:, None]
    at = np.arange(length) + 0.5
    return (at >= start) & (at < start + 2 * step)
