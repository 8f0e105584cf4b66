"""Masks of one frame as video models return them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from torch import Tensor
from torch.nn.functional import interpolate


class FrameMasks(NamedTuple):
    """Masks of one frame."""

    at: int
    logits: Tensor
    """(n, h', w') float32 on the CPU, of n objects at the model's own size; positive inside"""


def full_size(logits: Tensor, size: tuple[int, ...]) -> np.ndarray:
    """Resize logits (n, h', w') to (n, h, w) float32."""
    return interpolate(logits[:, None], size, mode="bilinear", align_corners=False)[:, 0].numpy()
