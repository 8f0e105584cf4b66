"""The door for users: an image and a task in, a `Prediction` at the image's own size out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from afford.models.twohands.batch import Batch
from afford.models.twohands.files import load
from afford.models.twohands.letterbox import letterbox, stack, unletterbox
from afford.models.twohands.model import TwoHands
from afford.models.twohands.select import select_hands
from schemas.prediction import Prediction


class Predictor:
    """A trained model that is ready to be asked.

    >>> predictor = Predictor("artifacts/models/small")
    >>> found = predictor.predict(image, "pour tea from kettle")
    >>> found.mask("left"), found.mask("right")
    """

    def __init__(self, model: str | Path | TwoHands, device: str = "cpu") -> None:
        """`model`: a folder that `files.save` wrote or a training published, or a model."""
        loaded = model if isinstance(model, TwoHands) else load(Path(model))
        self.model, self.device = loaded.to(device).eval(), device

    def predict(self, image: np.ndarray, task: str, hands: str = "auto") -> Prediction:
        """One (h, w, 3) uint8 RGB image and its task. `hands`: auto, left, right or both (see select.py).

        ValueError when the image has another shape or dtype.
        """
        return self.predict_batch([image], [task], hands)[0]

    def predict_batch(self, images: Sequence[np.ndarray], tasks: Sequence[str], hands: str = "auto") -> list[Prediction]:
        """The same for several images, each of its own size, in one pass through the model."""
        if len(images) != len(tasks):
            raise ValueError(f"expected one task for each image, got {len(images)} images and {len(tasks)} tasks")
        for image in images:
            _check(image)
        size = self.model.config.size_px
        batch = Batch(stack([letterbox(image, size) for image in images]).to(self.device), tuple(tasks))
        with torch.inference_mode():
            output = self.model(batch)
        taxonomy = output.taxonomy.float().softmax(-1).cpu().numpy()
        rows = zip(images, tasks, output.logits.float().cpu(), output.score.float().cpu(), taxonomy, strict=True)
        return [self._one(*row, hands) for row in rows]

    def _one(self, image: np.ndarray, task: str, logits: Tensor, score: Tensor, taxonomy: np.ndarray, hands: str) -> Prediction:
        height, width = image.shape[:2]
        chosen = select_hands(taxonomy, hands)
        masks = unletterbox(logits.flatten(0, 1), height, width, self.model.config.size_px)
        probability = masks.sigmoid().unflatten(0, logits.shape[:2]).numpy()
        return Prediction(task, probability, ranked(score, bool(chosen.all())).numpy(), taxonomy, chosen,
                          self.model.config.threshold)  # fmt: skip


def ranked(score: Tensor, together: bool) -> Tensor:
    """Score logits (2, k) -> probabilities (2, k). Two hands that act together share one row, the geometric mean of both, so
    that the two top-ranked regions belong to one grasp."""
    logs = score.log_softmax(-1)
    return (logs.mean(0, keepdim=True).expand_as(logs) if together else logs).softmax(-1).contiguous()


def _check(image: np.ndarray) -> None:
    if not isinstance(image, np.ndarray) or image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3 or not image.size:
        found = f"{image.dtype} {image.shape}" if isinstance(image, np.ndarray) else type(image).__name__
        raise ValueError(f"image: expected (h, w, 3) uint8 RGB, got {found}")
