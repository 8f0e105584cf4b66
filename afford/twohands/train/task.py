"""Batch number n of a training: samples drawn, augmented, letter-boxed and stacked. A function of (seed, n), in any order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from afford.dataset.load import Item
from afford.training.sampler import BalancedSampler
from afford.twohands.model.interface import Batch, Output, Target, TwoHands
from afford.twohands.model.letterbox import letterbox, letterbox_masks
from afford.twohands.model.letterbox import stack as stack_images
from afford.twohands.model.losses import LossParams, losses
from afford.twohands.train.augment import Augmentation, View, augment
from afford.twohands.train.validation import Validated, validation_metrics, write_preview


class InputSize(NamedTuple):
    """How samples come to the size of the model."""

    size_px: tuple[int, int]

    def image(self, image: np.ndarray) -> np.ndarray:
        """(h, w, 3) uint8 -> (H, W, 3) uint8."""
        return letterbox(image, self.size_px)

    def masks(self, masks: np.ndarray) -> np.ndarray:
        """(n, h, w) bool -> (n, H, W) bool."""
        return letterbox_masks(masks, self.size_px)

    def half(self) -> InputSize:
        """The same at half the size. ValueError where that is no multiple of 16 px."""
        if any(side % 32 for side in self.size_px):
            raise ValueError(f"model_train.height_px, width_px: expected multiples of 32 when some steps come at half the size "
                             f"(coarse_share is not 0), got {self.size_px}")  # fmt: skip
        return InputSize((self.size_px[0] // 2, self.size_px[1] // 2))


class SampleBatch(NamedTuple):
    """b samples at the size of the model."""

    image: np.ndarray
    """(b, H, W, 3) uint8 RGB"""
    masks: np.ndarray
    """(b, 4, H, W) bool: affordance left, right; complete object left, right"""
    task: tuple[str, ...]
    taxonomy: np.ndarray
    """(b,) int64, 0..3"""
    centre: np.ndarray
    """(b, 2) float32: centre of the things in the whole picture (`Seen.centre`)"""


@dataclass(frozen=True)
class Batches:
    """`batches(n)` is batch n."""

    samples: Sequence[Item]
    order: BalancedSampler
    views: Augmentation
    boxes: InputSize
    size: int
    """samples per batch"""
    seed: int
    coarse: int = 0
    """so many batches come first, of twice as many samples at half the size: of small pictures a few are hardly dearer than one"""

    def __call__(self, number: int) -> SampleBatch:
        first = self.size * (number + min(number, self.coarse))
        if number < self.coarse:
            return collate([self._sample(first + n) for n in range(2 * self.size)], self.boxes.half())
        return collate([self._sample(first + n) for n in range(self.size)], self.boxes)

    def _sample(self, position: int) -> View:
        _, index = self.order.sample(position)
        return augment(self.samples[index], self.views, self.seed, position)


def collate(seen: Sequence[View], boxes: InputSize) -> SampleBatch:
    """Samples of any size -> arrays at the size of the model."""
    items = [one.item for one in seen]
    return SampleBatch(
        image=np.stack([boxes.image(item.image) for item in items]),
        masks=np.stack([boxes.masks(item.masks) for item in items]),
        task=tuple(item.narration for item in items),
        taxonomy=np.array([item.taxonomy for item in items], np.int64),
        centre=np.stack([one.centre for one in seen]),
    )


TARGETS = {"affordance": slice(0, 2), "object": slice(2, 4)}
"""which two of a sample's four masks are learned"""


class TwoHandsTask:
    """What the loop trains (`afford.training.job.Task`)."""

    monitor = "iou"

    def __init__(self, model: TwoHands, batches: Batches, judged: Sequence[SampleBatch], loss: LossParams, target: str,
                 device: str) -> None:
        """`judged` are the batches of validation, never augmented; `target` is one of `TARGETS`."""
        self.model: nn.Module = model
        self.batches, self.judged, self.params, self.device = batches, judged, loss, device
        self.learned = TARGETS[target]
        self._said: list[Validated] = []

    def batch(self, number: int) -> SampleBatch:
        """Micro-batch `number`."""
        return self.batches(number)

    def loss(self, model: nn.Module, batch: SampleBatch) -> dict[str, Tensor]:
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
        return {**validation_metrics(said), "total": float(np.mean(totals))}

    def preview(self, folder: Path, step: int) -> None:
        """A sheet of the first samples of validation: what the model said of them a moment ago, and the truth."""
        rows = [(image, task) for batch in self.judged for image, task in zip(batch.image, batch.task, strict=True)]
        write_preview(folder / f"step_{step:07d}.jpg", rows, self._said)

    def _asked(self, batch: SampleBatch) -> Batch:
        return Batch(stack_images(list(batch.image)).to(self.device), batch.task)

    def _truth(self, batch: SampleBatch) -> Target:
        masks, things = (torch.from_numpy(batch.masks[:, part]).to(self.device) for part in (self.learned, TARGETS["object"]))
        taxonomy = torch.from_numpy(batch.taxonomy).to(self.device)
        centre = torch.from_numpy(batch.centre).to(self.device)
        return Target(masks.float(), masks.flatten(2).any(-1), taxonomy, things.float(), centre)

    def _answers(self, output: Output, batch: SampleBatch) -> list[Validated]:
        """Probabilities at the size of the model, sample by sample."""
        size, truth = batch.masks.shape[-2:], batch.masks[:, self.learned]
        large = nn.functional.interpolate(output.logits.float().flatten(1, 2), size, mode="bilinear", align_corners=False)
        probability = large.sigmoid().unflatten(1, output.logits.shape[1:3]).cpu().numpy()
        score, taxonomy = output.score.float().cpu(), output.taxonomy.float().softmax(-1).cpu().numpy()
        rows = zip(probability, score, taxonomy, truth, batch.taxonomy, strict=True)
        return [Validated.of(*row) for row in rows]


def validation_batches(samples: Sequence[View], boxes: InputSize, size: int) -> list[SampleBatch]:
    """Samples in order, as batches."""
    return [collate(samples[n : n + size], boxes) for n in range(0, len(samples), size)]
