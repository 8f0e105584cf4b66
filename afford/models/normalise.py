"""Normalisation of pictures by the published constants of ImageNet and of CLIP's image tower."""

from __future__ import annotations

from torch import Tensor
from torch.nn.functional import interpolate

MEAN = (0.485, 0.456, 0.406)
"""mean colour, RGB 0..1, of ImageNet; it also fills the letter-box"""
DEVIATION = (0.229, 0.224, 0.225)
CLIP_MEAN = (0.48145466, 0.4578275, 0.40821073)
"""mean colour of CLIP's image tower"""
CLIP_DEVIATION = (0.26862954, 0.26130258, 0.27577711)


def normalised(image: Tensor) -> Tensor:
    """Normalise images (b, 3, h, w) 0..1 by the mean and deviation of ImageNet."""
    return _shifted(image, MEAN, DEVIATION)


def for_tower(image: Tensor, size: int) -> Tensor:
    """Resize and normalise images (b, 3, h, w) 0..1 to (b, 3, size, size) for CLIP's image tower."""
    image = interpolate(image, (size, size), mode="bilinear", align_corners=False, antialias=True)
    return _shifted(image, CLIP_MEAN, CLIP_DEVIATION)


def _shifted(image: Tensor, mean: tuple[float, ...], deviation: tuple[float, ...]) -> Tensor:
    return (image - image.new_tensor(mean).view(1, 3, 1, 1)) / image.new_tensor(deviation).view(1, 3, 1, 1)
