"""What simpler recipes would say: the paper's, a coarse box, relevance of pixels, all of the object, or any candidate."""

from __future__ import annotations

import numpy as np

from afford.render.views.plan import SIX, six
from afford.surface.negative.coarse import coarse_box, segmented
from afford.surface.negative.project import on_faces
from afford.surface.negative.relevance import RELEVANT, relevance
from afford.surface.negative.votes import squareness
from schemas.mesh import ObjectMesh, ObjectViews
from schemas.surface import PartCandidates, PartDescription, PartScores

COARSE = 3
"""the paper's z-buffer has a third of the views' size"""
NEAR = 0.1
"""points within this share of the object's longest side behind what the z-buffer has count as seen"""
NEARLY_ALL = 0.9
"""a mask that holds so much of what a view shows of the object has taken the whole of it"""

Taken = list[np.ndarray | None]
"""the mask (h, w) bool that was taken in each of the six views, or None"""


def whole(mesh: ObjectMesh) -> np.ndarray:
    """(f,) bool: everything."""
    return np.ones(len(mesh.faces), bool)


def random_candidate(candidates: PartCandidates, rng: np.random.Generator) -> Taken:
    """Any candidate in each of the six views."""
    each = (_of(candidates, view) for view in range(SIX))
    return [candidates.masks[rng.choice(mine)] if len(mine) else None for mine in each]


def paper(candidates: PartCandidates, description: PartDescription, scores: PartScores) -> Taken:
    """AffordDex's recipe (its negative affordance segmentation) with our candidates and scores: one negative part, and the mask
    that fits it best in each of six views, however badly.
    """
    note = _first_negative(description)
    if note is None:
        return [None] * SIX
    each = (_of(candidates, view) for view in range(SIX))
    return [candidates.masks[mine[scores.overlap[mine, note].argmax()]] if len(mine) else None for mine in each]


def naive(views: ObjectViews, candidates: PartCandidates, windows: PartCandidates, description: PartDescription,
          fits: PartScores) -> Taken:  # fmt: skip
    """A coarse box around one negative part in each of six views, then the mask that fills it best; `fits` are scores of the
    windows.
    """
    note, taken = _first_negative(description), Taken([None] * SIX)
    if note is None:
        return taken
    for view in sorted({*windows.view.tolist()}):
        mine = _of(windows, view)
        asked = coarse_box(windows.masks[mine], fits.share[mine, note])
        taken[view] = segmented(asked, candidates.masks[_of(candidates, view)], views.face[view] >= 0)
    return taken


def relevant(mesh: ObjectMesh, views: ObjectViews, windows: PartCandidates, description: PartDescription,
             fits: PartScores) -> np.ndarray:  # fmt: skip
    """(f,) bool: faces whose pixels in six views are relevant for the negative parts, by exact visibility as ours."""
    seen = six(views)
    value, count = relevance(windows, fits, description, seen.face.shape)
    return on_faces(mesh, seen, value, np.where(count > 0, squareness(mesh, seen), 0))[0] > RELEVANT


def whole_object_taken(views: ObjectViews, taken: Taken) -> float:
    """Share of the masks taken that hold nearly all that their view shows of the object; NaN where none was taken."""
    on = views.face[: len(taken)] >= 0
    shares = [(mask & one).sum() / max(one.sum(), 1) for mask, one in zip(taken, on, strict=True) if mask is not None]
    return float(np.mean([share >= NEARLY_ALL for share in shares])) if shares else float("nan")


def splatted(mesh: ObjectMesh, views: ObjectViews, taken: Taken) -> np.ndarray:
    """(f,) bool: the middles of faces that fall into a mask and are not far behind the z-buffer of all middles, in any view: the
    paper's projection.
    """
    middle = mesh.vertices[mesh.faces].mean(1).astype(np.float64)
    near = NEAR * float(np.ptp(mesh.vertices, axis=0).max())
    out = np.zeros(len(middle), bool)
    for view, mask in enumerate(taken):
        if mask is None:
            continue
        seen = (middle - views.T_obj_cam[view][:3, 3]) @ views.T_obj_cam[view][:3, :3] @ views.K[view].T
        height, width = mask.shape
        x, y = (np.rint(seen[:, k] / seen[:, 2]).astype(int).clip(0, side - 1) for k, side in ((0, width), (1, height)))
        coarse = np.full([-(-side // COARSE) for side in mask.shape], np.inf)
        np.minimum.at(coarse, (y // COARSE, x // COARSE), seen[:, 2])
        out |= mask[y, x] & (np.abs(seen[:, 2] - coarse[y // COARSE, x // COARSE]) < near)
    return out


def _first_negative(description: PartDescription) -> int | None:
    return next((k for k, note in enumerate(description.notes) if note.role == "negative"), None)


def _of(candidates: PartCandidates, view: int) -> np.ndarray:
    """Indices of the candidates of a view."""
    return np.flatnonzero(candidates.view == view)
