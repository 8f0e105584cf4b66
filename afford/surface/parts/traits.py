"""Four numbers that come with a candidate: what a crop does not tell, since it is scaled and flat."""

from __future__ import annotations

import numpy as np

from schemas.mesh import ObjectViews
from schemas.surface import PartCandidates


def mask_traits(views: ObjectViews, candidates: PartCandidates, thickness: np.ndarray) -> np.ndarray:
    """(m, 4) float32, all within about -1..1: share of what the view shows of the object, elongation of the mask, thickness of the
    object behind it (f,) over that of the whole view, and how much the mask stands out.
    """
    out = np.zeros((len(candidates.view), 4), np.float32)
    log = np.append(np.log(thickness), 0.0)
    for n, (view, mask) in enumerate(zip(candidates.view, candidates.masks, strict=True)):
        face = views.face[view]
        on = face >= 0
        thicker = (log[face[mask]].mean() - log[face[on]].mean()) / 3
        out[n] = mask.sum() / max(on.sum(), 1), _elongation(mask), thicker, candidates.quality[n]
    return out


def _elongation(mask: np.ndarray) -> float:
    """0 for what is as wide as long, towards 1 for a needle."""
    y, x = np.nonzero(mask)
    if len(x) < 3:
        return 0.0
    small, large = np.linalg.eigvalsh(np.cov(np.stack([x, y]).astype(np.float64)) + 1e-6 * np.eye(2))
    return float(1 - np.sqrt(small / large))
