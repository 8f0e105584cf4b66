"""The task of the two-hand models: batches of images and words in, the losses of `afford.twohands.model` out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from afford.twohands.model.batch import Batch, Output, Target
from afford.twohands.model.letterbox import stack as stack_images
from afford.twohands.model.losses import LossParams, losses
from afford.twohands.model.model import TwoHands
from afford.twohands.train import preview
from afford.twohands.train.batches import Arrays, Batches, Boxes, stack
from afford.twohands.train.scores import Said, measure
from afford.twohands.train.views import Seen

TARGETS = {"affordance": slice(0, 2), "object": slice(2, 4)}
"""which two of a sample's four masks are learned"""


class Hands:
    """What the loop trains (`afford.training.job.Task`)."""

    monitor = "iou"

    def __init__(self, model: TwoHands, batches: Batches, judged: Sequence[Arrays], loss: LossParams, target: str,
                 device: str) -> None:
        """`judged` are the batches of validation, never augmented; `target` is one of `TARGETS`."""
        self.model: nn.Module = model
        self.batches, self.judged, self.params, self.device = batches, judged, loss, device
        self.learned = TARGETS[target]
        self._said: list[Said] = []

    def batch(self, number: int) -> Arrays:
        """Micro-batch `number`."""
        return self.batches(number)

    def loss(self, model: nn.Module, batch: Arrays) -> dict[str, Tensor]:
        """The losses by name."""
        return losses(model(self._asked(batch)), self._truth(batch), self.params)

    def validate(self) -> dict[str, float]:
        """IoU and its kin at the best threshold, the share of right taxonomies, and the loss."""
        said, totals = [], []
        for batch in self.judged:
            output = self.model(self._asked(batch))
            totals.append(float(losses(output, self._truth(batch), self.params)["total"]))
            said += self._answers(output, batch)
        self._said = said
        return {**measure(said), "total": float(np.mean(totals))}

    def preview(self, folder: Path, step: int) -> None:
        """A sheet of the first samples of validation: what the model said of them a moment ago, and the truth."""
        rows = [(image, task) for batch in self.judged for image, task in zip(batch.image, batch.task, strict=True)]
        preview.write(folder / f"step_{step:07d}.jpg", rows, self._said)

    def _asked(self, batch: Arrays) -> Batch:
        return Batch(stack_images(list(batch.image)).to(self.device), batch.task)

    def _truth(self, batch: Arrays) -> Target:
        masks, things = (torch.from_numpy(batch.masks[:, part]).to(self.device) for part in (self.learned, TARGETS["object"]))
        taxonomy = torch.from_numpy(batch.taxonomy).to(self.device)
        centre = torch.from_numpy(batch.centre).to(self.device)
        return Target(masks.float(), masks.flatten(2).any(-1), taxonomy, things.float(), centre)

    def _answers(self, output: Output, batch: Arrays) -> list[Said]:
        """Probabilities at the size of the model, sample by sample."""
        size, truth = batch.masks.shape[-2:], batch.masks[:, self.learned]
        large = nn.functional.interpolate(output.logits.float().flatten(1, 2), size, mode="bilinear", align_corners=False)
        probability = large.sigmoid().unflatten(1, output.logits.shape[1:3]).cpu().numpy()
        score, taxonomy = output.score.float().cpu(), output.taxonomy.float().softmax(-1).cpu().numpy()
        rows = zip(probability, score, taxonomy, truth, batch.taxonomy, strict=True)
        return [Said.of(*row) for row in rows]


def judged_batches(samples: Sequence[Seen], boxes: Boxes, size: int) -> list[Arrays]:
    """Samples in order, as batches."""
    return [stack(samples[n : n + size], boxes) for n in range(0, len(samples), size)]
