"""Inpainting by video diffusion, as 2HandedAfforder does it: each frame from itself and three others, far apart in time.

Works at 256 x 256 on the whole frame, padded to a square with black at the top (landscape) or left (portrait), and is scaled back.
Reads `params.model` (folder or hub id), `params.ddim_steps`, `params.ddim_eta`, `params.seed`.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from afford.backends.inpaint import Filled
from afford.models.vidm import FRAMES, fill, load_model
from schemas.masks import Tracks
from schemas.video import Frames, PixelSource

SIZE_PX = 256
CONFIDENCE = 128
"""a sample of a generative model is neither seen nor blind"""


def inpaint(frames: Frames, tracks: Tracks, hole: np.ndarray, params: Any) -> Filled:
    """See `Inpaint`. Frames without a hole are copied."""
    model = load_model(params.model)
    out = frames.rgb.copy()
    small = np.stack([cv2.resize(_square(image), (SIZE_PX, SIZE_PX), interpolation=cv2.INTER_AREA) for image in frames.rgb])
    holes = np.stack([_shrink(mask) for mask in hole])
    for t in np.flatnonzero(hole.any(axis=(1, 2))):
        group = context(int(t), len(small))
        steps = {"steps": params.ddim_steps, "eta": params.ddim_eta, "seed": params.seed + int(t)}
        out[t] = _unsquare(fill(model, small[group], holes[group], **steps), frames.rgb.shape[1:3])
    source = np.where(hole, PixelSource.BACKGROUND, PixelSource.ORIGINAL).astype(np.uint8)
    return Filled(out, source, np.where(hole, CONFIDENCE, 255).astype(np.uint8))


def context(t: int, length: int) -> list[int]:
    """Positions of the three context frames, a quarter of the clip apart, then the target itself."""
    return [(t + (k * length) // FRAMES) % length for k in range(1, FRAMES)] + [t]


def _square(image: np.ndarray) -> np.ndarray:
    height, width = image.shape[:2]
    side = max(height, width)
    return cv2.copyMakeBorder(image, side - height, 0, side - width, 0, cv2.BORDER_CONSTANT, value=0)


def _shrink(mask: np.ndarray) -> np.ndarray:
    """A hole at 256 x 256 that leaves out no pixel of the hole at full size."""
    full = _square(mask.astype(np.uint8)) * 255
    return cv2.resize(full, (SIZE_PX, SIZE_PX), interpolation=cv2.INTER_AREA) > 0


def _unsquare(image: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    side = max(shape)
    return cv2.resize(image, (side, side), interpolation=cv2.INTER_LINEAR)[side - shape[0] :, side - shape[1] :]
