"""A coarse box from what fits the words, then the mask that fills it best: a describer's box, and segmentation in it.

The box has the resolution of the windows that it is made of. A Segment Anything model would take it as a prompt; here the mask is
chosen among those that there are, whoever proposed them, and the whole silhouette, which such a model offers as well.
"""

from __future__ import annotations

import numpy as np

from afford.common.masks import Box, box

LEAST = 0.85
"""a window belongs to the box when its fit is at least this share of the best one's; chosen on the objects that judge the scorer's
training, where more does the same and less does worse"""


def coarse_box(windows: np.ndarray, fit: np.ndarray) -> Box:
    """The box around those of the windows (m, h, w) bool of a view that fit a part well, `fit` (m,) 0..1; m is 1 or more."""
    return box(windows[fit >= LEAST * fit.max()].any(0))


def segmented(asked: Box, masks: np.ndarray, on: np.ndarray) -> np.ndarray:
    """(h, w) bool: of the masks (m, h, w) of a view and the silhouette `on` (h, w), that whose box is most like the one asked for;
    of equals the first.
    """
    offered = [*masks, on]
    return np.asarray(offered[int(np.argmax([overlap(asked, box(mask)) for mask in offered]))])


def overlap(a: Box, b: Box) -> float:
    """IoU of two boxes; 0 where both are empty."""
    both = np.prod([max(0, min(p.stop, q.stop) - max(p.start, q.start)) for p, q in zip(a, b, strict=True)])
    size = sum(int(np.prod([side.stop - side.start for side in one])) for one in (a, b))
    return float(both / max(size - both, 1))
