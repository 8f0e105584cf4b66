"""What every two-hand model is to those who train, save and use it."""

from __future__ import annotations

from abc import ABC, abstractmethod

from torch import nn

from afford.twohands.model.batch import Batch, Output
from afford.twohands.model.config import ModelConfig


class TwoHands(nn.Module, ABC):
    """An image and a task in, a region for each hand out. Parameters that are frozen have `requires_grad` off."""

    config: ModelConfig

    @abstractmethod
    def forward(self, batch: Batch) -> Output:
        """Regions, scores and taxonomy of b images; in training mode `text_loss` too where the model writes an answer."""

    def extra_files(self) -> dict[str, str]:
        """Name -> text of what must lie beside the weights to build this model again, config.json apart."""
        return {}


