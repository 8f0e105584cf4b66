"""Letter-box: the whole image at model size, in the upper left corner, with its aspect ratio; the rest has the mean colour.

Training and prediction both use it.
"""

from __future__ import annotations

import cv2
import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import interpolate

FILL = (124, 116, 104)
"""mean colour of the published preprocessing, RGB"""


def content_size(height: int, width: int, size_px: tuple[int, int]) -> tuple[int, int]:
    """Height and width of an image of (height, width) inside the box, each at least 1 px."""
    scale = min(size_px[0] / height, size_px[1] / width)
    return max(1, round(height * scale)), max(1, round(width * scale))


def letterbox(image: np.ndarray, size_px: tuple[int, int]) -> np.ndarray:
    """(h, w, 3) uint8 RGB -> (H, W, 3) uint8."""
    boxed = np.full((*size_px, 3), FILL, np.uint8)
    height, width = content_size(image.shape[0], image.shape[1], size_px)
    boxed[:height, :width] = _resized(image, height, width)
    return boxed


def letterbox_masks(masks: np.ndarray, size_px: tuple[int, int]) -> np.ndarray:
    """(n, h, w) bool -> (n, H, W) bool; a pixel is inside when at least half of it was. Nothing is inside the padding."""
    boxed = np.zeros((len(masks), *size_px), bool)
    height, width = content_size(masks.shape[1], masks.shape[2], size_px)
    for found, mask in zip(boxed, masks, strict=True):
        found[:height, :width] = _resized(mask.astype(np.uint8) * 255, height, width) > 127
    return boxed


def unletterbox(logits: Tensor, height: int, width: int, size_px: tuple[int, int]) -> Tensor:
    """(n, h', w') logits over the whole box -> (n, height, width) at the image's own size, bilinear."""
    inner = content_size(height, width, size_px)
    boxed = interpolate(logits[None], size_px, mode="bilinear", align_corners=False)
    content = boxed[..., : inner[0], : inner[1]]
    return interpolate(content, (height, width), mode="bilinear", align_corners=False)[0]


def to_tensor(images: list[np.ndarray]) -> Tensor:
    """b boxes (H, W, 3) uint8 -> (b, 3, H, W) float32 0..1, as in `Batch.image`."""
    return torch.from_numpy(np.stack(images)).permute(0, 3, 1, 2).float() / 255


def _resized(image: np.ndarray, height: int, width: int) -> np.ndarray:
    smaller = height < image.shape[0] or width < image.shape[1]
    found: np.ndarray = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA if smaller else cv2.INTER_LINEAR)
    return found
