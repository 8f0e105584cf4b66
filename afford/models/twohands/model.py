"""What every two-hand model is to those who train, save and use it."""

from __future__ import annotations

from torch import Tensor, nn

from afford.models.twohands.batch import Batch, Output
from afford.models.twohands.config import ModelConfig

MEAN = (0.485, 0.456, 0.406)
"""mean colour, RGB 0..1, of the published preprocessing (ImageNet); the letter-box is filled with it"""
DEVIATION = (0.229, 0.224, 0.225)


class TwoHands(nn.Module):
    """An image and a task in, a region for each hand out. Parameters that are frozen have `requires_grad` off."""

    config: ModelConfig

    def forward(self, batch: Batch) -> Output:
        """Regions, scores and taxonomy of b images; in training mode `text_loss` too where the model writes an answer."""
        raise NotImplementedError

    def extra_files(self) -> dict[str, str]:
        """Name -> text of what must lie beside the weights to build this model again, config.json apart."""
        return {}


def normalised(image: Tensor) -> Tensor:
    """(b, 3, h, w) 0..1 -> zero mean, unit deviation, by the published constants."""
    mean, deviation = (image.new_tensor(values).view(1, 3, 1, 1) for values in (MEAN, DEVIATION))
    return (image - mean) / deviation
