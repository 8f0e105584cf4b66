"""Baselines of negative affordance: the paper's recipe, a coarse box, CLIP relevance, whole object, random mask.

The coarse box stands for a describer that returns a box, followed by segmentation in the box. The box has the resolution of the
windows that it is built from. A Segment Anything model would take the box as a prompt; this baseline chooses among the existing
candidates and the whole silhouette, which such a model offers as well. For relevance, windows are scored like candidates, but all
of them have the same weight.
"""

from __future__ import annotations

import numpy as np

from afford.common.masks import Box, box
from afford.render.views.plan import SIX, cardinal_views
from afford.surface.negative.project import cos_incidence, part_posterior, project_to_faces, weighted_pixel_mean
from schemas.mesh import ObjectMesh, ObjectViews
from schemas.surface import PartCandidates, PartDescription, PartScores

LEAST = 0.85
"""a window belongs to the box if its fit is at least this share of the best fit; chosen on the validation objects of the scorer,
where larger values do the same and smaller ones do worse
"""


def coarse_box(windows: np.ndarray, fit: np.ndarray) -> Box:
    """Return the bounding box of the windows (m, h, w) bool of a view that fit a part well; `fit` (m,) 0..1, m >= 1."""
    return box(windows[fit >= LEAST * fit.max()].any(0))


def mask_in_box(target: Box, masks: np.ndarray, on: np.ndarray) -> np.ndarray:
    """Choose the mask (h, w) bool whose bounding box has the largest IoU with a box.

    Choices are the masks (m, h, w) of a view and the silhouette `on` (h, w); the first one wins a tie.
    """
    offered = [*masks, on]
    return np.asarray(offered[int(np.argmax([box_iou(target, box(mask)) for mask in offered]))])


def box_iou(a: Box, b: Box) -> float:
    """Compute the IoU of two boxes; 0 if both are empty."""
    both = np.prod([max(0, min(p.stop, q.stop) - max(p.start, q.start)) for p, q in zip(a, b, strict=True)])
    size = sum(int(np.prod([side.stop - side.start for side in one])) for one in (a, b))
    return float(both / max(size - both, 1))


RELEVANT = 0.4
"""relevance above which a pixel is negative; chosen on the validation objects of the scorer, where 0.3 to 0.5 do nearly the same"""


def relevance(windows: PartCandidates, scores: PartScores, description: PartDescription,
              shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Compute the relevance (n, h, w) float32 0..1 of each pixel, and the number of windows (n, h, w) that cover it.

    A window that fits no part has relevance 0.
    """
    value, counts = part_posterior(scores, description)
    return weighted_pixel_mean(windows, np.where(counts > 0, value, 0), np.ones_like(value), shape)


COARSE = 3
"""the paper's z-buffer has a third of the views' resolution"""
NEAR = 0.1
"""depth tolerance of the z-buffer, as a share of the object's longest side"""
NEARLY_ALL = 0.9
"""share of the visible object from which a mask counts as the whole object"""

ViewMasks = list[np.ndarray | None]
"""selected mask (h, w) bool of each of the six views, or None"""


def whole_object(mesh: ObjectMesh) -> np.ndarray:
    """Mark all faces: (f,) bool."""
    return np.ones(len(mesh.faces), bool)


def random_candidate(candidates: PartCandidates, rng: np.random.Generator) -> ViewMasks:
    """Select a random candidate in each of the six views."""
    each = (_of(candidates, view) for view in range(SIX))
    return [candidates.masks[rng.choice(mine)] if len(mine) else None for mine in each]


def paper_recipe(candidates: PartCandidates, description: PartDescription, scores: PartScores) -> ViewMasks:
    """Select masks by AffordDex's recipe with our candidates and scores.

    One negative part, and the mask that fits it best in each of six views, however badly.
    """
    note = _first_negative(description)
    if note is None:
        return [None] * SIX
    each = (_of(candidates, view) for view in range(SIX))
    return [candidates.masks[mine[scores.overlap[mine, note].argmax()]] if len(mine) else None for mine in each]


def coarse_box_recipe(views: ObjectViews, candidates: PartCandidates, windows: PartCandidates, description: PartDescription,
          fits: PartScores) -> ViewMasks:  # fmt: skip
    """Select the mask that fills a coarse box around one negative part, in each of six views.

    `fits` are the scores of the windows.
    """
    note, taken = _first_negative(description), ViewMasks([None] * SIX)
    if note is None:
        return taken
    for view in sorted({*windows.view.tolist()}):
        mine = _of(windows, view)
        target = coarse_box(windows.masks[mine], fits.share[mine, note])
        taken[view] = mask_in_box(target, candidates.masks[_of(candidates, view)], views.face[view] >= 0)
    return taken


def clip_relevance(mesh: ObjectMesh, views: ObjectViews, windows: PartCandidates, description: PartDescription,
             fits: PartScores) -> np.ndarray:  # fmt: skip
    """Mark faces (f,) bool whose pixels in six views are relevant for the negative parts."""
    seen = cardinal_views(views)
    value, count = relevance(windows, fits, description, seen.face.shape)
    return project_to_faces(mesh, seen, value, np.where(count > 0, cos_incidence(mesh, seen), 0))[0] > RELEVANT


def whole_object_taken(views: ObjectViews, taken: ViewMasks) -> float:
    """Return the share of selected masks that cover nearly the whole visible object; NaN without a mask."""
    on = views.face[: len(taken)] >= 0
    shares = [(mask & one).sum() / max(one.sum(), 1) for mask, one in zip(taken, on, strict=True) if mask is not None]
    return float(np.mean([share >= NEARLY_ALL for share in shares])) if shares else float("nan")


def splat_masks(mesh: ObjectMesh, views: ObjectViews, taken: ViewMasks) -> np.ndarray:
    """Project masks to faces (f,) bool as the paper does.

    A face counts if its centre falls into a mask of any view and is not far behind the z-buffer of all face centres.
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
    """Return the indices of the candidates of a view."""
    return np.flatnonzero(candidates.view == view)
