"""How relevant every pixel is for the negative parts, without candidates: the mean over the windows that hold it.

Windows are scored as candidates are and the parts compete for them in the same way, but none counts more than another: nothing has
told which window is a part.
"""

from __future__ import annotations

import numpy as np

from afford.surface.negative.fuse import part_posterior, weighted_pixel_mean
from schemas.surface import PartCandidates, PartDescription, PartScores

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
