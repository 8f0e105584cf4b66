"""What simpler recipes would say: the paper's, all of the object, or any candidate."""

from __future__ import annotations

import numpy as np

from schemas.mesh import ObjectMesh, ObjectViews
from schemas.negative import PartCandidates, PartDescription, PartScores

SIX = 6
COARSE = 3
"""the paper's z-buffer has a third of the views' size"""
NEAR = 0.1
"""points within this share of the object's longest side behind what the z-buffer has count as seen"""


def whole(mesh: ObjectMesh) -> np.ndarray:
    """(f,) bool: everything."""
    return np.ones(len(mesh.faces), bool)


def random_candidate(mesh: ObjectMesh, views: ObjectViews, candidates: PartCandidates, rng: np.random.Generator) -> np.ndarray:
    """(f,) bool: the faces of one candidate in each of the six views."""
    chosen = [_any(candidates, view, rng) for view in range(SIX)]
    return _splatted(mesh, views, [None if n is None else candidates.masks[n] for n in chosen])


def paper(mesh: ObjectMesh, views: ObjectViews, candidates: PartCandidates, description: PartDescription,
          scores: PartScores) -> np.ndarray:  # fmt: skip
    """(f,) bool by AffordDex's recipe with our candidates and scores: one negative part, the mask that fits it best in each of six
    views, however badly, and points splatted through a coarse z-buffer. papers: section 7.2."""
    notes = [k for k, note in enumerate(description.notes) if note.role == "negative"]
    if not notes:
        return np.zeros(len(mesh.faces), bool)
    masks: list[np.ndarray | None] = []
    for view in range(SIX):
        mine = np.flatnonzero(candidates.view == view)
        masks.append(candidates.masks[mine[scores.overlap[mine, notes[0]].argmax()]] if len(mine) else None)
    return _splatted(mesh, views, masks)


def _any(candidates: PartCandidates, view: int, rng: np.random.Generator) -> int | None:
    mine = np.flatnonzero(candidates.view == view)
    return int(rng.choice(mine)) if len(mine) else None


def _splatted(mesh: ObjectMesh, views: ObjectViews, masks: list[np.ndarray | None]) -> np.ndarray:
    """(f,) bool: the middles of faces that fall into a mask and are not far behind the z-buffer of all middles, in any view."""
    middle = mesh.vertices[mesh.faces].mean(1).astype(np.float64)
    near = NEAR * float(np.ptp(mesh.vertices, axis=0).max())
    out = np.zeros(len(middle), bool)
    for view, mask in enumerate(masks):
        if mask is None:
            continue
        seen = (middle - views.T_obj_cam[view][:3, 3]) @ views.T_obj_cam[view][:3, :3] @ views.K[view].T
        height, width = mask.shape
        x, y = (np.rint(seen[:, k] / seen[:, 2]).astype(int).clip(0, side - 1) for k, side in ((0, width), (1, height)))
        coarse = np.full([-(-side // COARSE) for side in mask.shape], np.inf)
        np.minimum.at(coarse, (y // COARSE, x // COARSE), seen[:, 2])
        out |= mask[y, x] & (np.abs(seen[:, 2] - coarse[y // COARSE, x // COARSE]) < near)
    return out
