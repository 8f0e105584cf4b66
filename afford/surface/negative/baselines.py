"""What simpler recipes would say: the paper's, a coarse box, relevance of pixels, all of the object, or any candidate."""

from __future__ import annotations

import numpy as np

from afford.common.masks import Box, box
from afford.render.views.plan import SIX, cardinal_views
from afford.surface.negative.project import cos_incidence, part_posterior, project_to_faces, weighted_pixel_mean
from schemas.mesh import ObjectMesh, ObjectViews
from schemas.surface import PartCandidates, PartDescription, PartScores

LEAST = 0.85
"""a window belongs to the box when its fit is at least this share of the best one's; chosen on the objects that judge the scorer's
training, where more does the same and less does worse"""


def coarse_box(windows: np.ndarray, fit: np.ndarray) -> Box:
    """The box around those of the windows (m, h, w) bool of a view that fit a part well, `fit` (m,) 0..1; m is 1 or more."""
    return box(windows[fit >= LEAST * fit.max()].any(0))


def mask_in_box(asked: Box, masks: np.ndarray, on: np.ndarray) -> np.ndarray:
    """(h, w) bool: of the masks (m, h, w) of a view and the silhouette `on` (h, w), that whose box is most like the one asked for;
    of equals the first.
    """
    offered = [*masks, on]
    return np.asarray(offered[int(np.argmax([box_iou(asked, box(mask)) for mask in offered]))])


def box_iou(a: Box, b: Box) -> float:
    """IoU of two boxes; 0 where both are empty."""
    both = np.prod([max(0, min(p.stop, q.stop) - max(p.start, q.start)) for p, q in zip(a, b, strict=True)])
    size = sum(int(np.prod([side.stop - side.start for side in one])) for one in (a, b))
    return float(both / max(size - both, 1))


RELEVANT = 0.4
"""relevance above which a pixel is negative; chosen on the objects that judge the scorer's training, where anything from 0.3 to 0.5
does nearly the same"""


def relevance(windows: PartCandidates, scores: PartScores, description: PartDescription,
              shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Relevance (n, h, w) float32 0..1 of each pixel, and the number of windows (n, h, w) that hold it. A window that fits no part
    is relevant for none.
    """
    value, counts = part_posterior(scores, description)
    return weighted_pixel_mean(windows, np.where(counts > 0, value, 0), np.ones_like(value), shape)


COARSE = 3
"""the paper's z-buffer has a third of the views' size"""
NEAR = 0.1
"""points within this share of the object's longest side behind what the z-buffer has count as seen"""
NEARLY_ALL = 0.9
"""a mask that holds so much of what a view shows of the object has taken the whole of it"""

ViewMasks = list[np.ndarray | None]
"""the mask (h, w) bool that was taken in each of the six views, or None"""


def whole_object(mesh: ObjectMesh) -> np.ndarray:
    """(f,) bool: everything."""
    return np.ones(len(mesh.faces), bool)


def random_candidate(candidates: PartCandidates, rng: np.random.Generator) -> ViewMasks:
    """Any candidate in each of the six views."""
    each = (_of(candidates, view) for view in range(SIX))
    return [candidates.masks[rng.choice(mine)] if len(mine) else None for mine in each]


def paper_recipe(candidates: PartCandidates, description: PartDescription, scores: PartScores) -> ViewMasks:
    """AffordDex's recipe (its negative affordance segmentation) with our candidates and scores: one negative part, and the mask
    that fits it best in each of six views, however badly.
    """
    note = _first_negative(description)
    if note is None:
        return [None] * SIX
    each = (_of(candidates, view) for view in range(SIX))
    return [candidates.masks[mine[scores.overlap[mine, note].argmax()]] if len(mine) else None for mine in each]


def coarse_box_recipe(views: ObjectViews, candidates: PartCandidates, windows: PartCandidates, description: PartDescription,
          fits: PartScores) -> ViewMasks:  # fmt: skip
    """A coarse box around one negative part in each of six views, then the mask that fills it best; `fits` are scores of the
    windows.
    """
    note, taken = _first_negative(description), ViewMasks([None] * SIX)
    if note is None:
        return taken
    for view in sorted({*windows.view.tolist()}):
        mine = _of(windows, view)
        asked = coarse_box(windows.masks[mine], fits.share[mine, note])
        taken[view] = mask_in_box(asked, candidates.masks[_of(candidates, view)], views.face[view] >= 0)
    return taken


def clip_relevance(mesh: ObjectMesh, views: ObjectViews, windows: PartCandidates, description: PartDescription,
             fits: PartScores) -> np.ndarray:  # fmt: skip
    """(f,) bool: faces whose pixels in six views are relevant for the negative parts, by exact visibility as ours."""
    seen = cardinal_views(views)
    value, count = relevance(windows, fits, description, seen.face.shape)
    return project_to_faces(mesh, seen, value, np.where(count > 0, cos_incidence(mesh, seen), 0))[0] > RELEVANT


def whole_object_taken(views: ObjectViews, taken: ViewMasks) -> float:
    """Share of the masks taken that hold nearly all that their view shows of the object; NaN where none was taken."""
    on = views.face[: len(taken)] >= 0
    shares = [(mask & one).sum() / max(one.sum(), 1) for mask, one in zip(taken, on, strict=True) if mask is not None]
    return float(np.mean([share >= NEARLY_ALL for share in shares])) if shares else float("nan")


def splat_masks(mesh: ObjectMesh, views: ObjectViews, taken: ViewMasks) -> np.ndarray:
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
