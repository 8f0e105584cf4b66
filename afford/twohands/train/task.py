"""Training task of the two-hand models: seeded batches, losses, and validation for the shared training loop.

Batch n is a function of the seed and n alone, so that batches can be computed in any order and a training can be resumed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from afford.dataset.load import Item
from afford.training.loop import derive_seed
from afford.training.sampler import BalancedSampler
from afford.twohands.model.interface import Batch, Output, Target, TwoHands
from afford.twohands.model.letterbox import letterbox, letterbox_masks
from afford.twohands.model.letterbox import to_tensor as stack_images
from afford.twohands.model.losses import LossParams, losses
from afford.twohands.train.augment import Augmentation, AugmentedSample, augment
from afford.twohands.train.validation import ValidationSample, validation_metrics, write_preview


class InputSize(NamedTuple):
    """Letter-boxing of samples to the input size of the model."""

    size_px: tuple[int, int]

    def image(self, image: np.ndarray) -> np.ndarray:
        """Letter-box an image: (h, w, 3) uint8 -> (H, W, 3) uint8."""
        return letterbox(image, self.size_px)

    def masks(self, masks: np.ndarray) -> np.ndarray:
        """Letter-box masks: (n, h, w) bool -> (n, H, W) bool."""
        return letterbox_masks(masks, self.size_px)

    def half(self) -> InputSize:
        """Half of this size. ValueError when half a side is not a multiple of 16 px."""
        if any(side % 32 for side in self.size_px):
            raise ValueError(f"model_train.height_px, width_px: expected multiples of 32 when some steps are at half the size "
                             f"(coarse_share is not 0), got {self.size_px}")  # fmt: skip
        return InputSize((self.size_px[0] // 2, self.size_px[1] // 2))


class SampleBatch(NamedTuple):
    """b samples at the input size of the model."""

    image: np.ndarray
    """(b, H, W, 3) uint8 RGB"""
    masks: np.ndarray
    """(b, 4, H, W) bool: affordance left, right; complete object left, right"""
    task: tuple[str, ...]
    taxonomy: np.ndarray
    """(b,) int64, 0..3"""
    centre: np.ndarray
    """(b, 2) float32: centre of the objects in the whole picture (`AugmentedSample.centre`)"""
    asked: tuple[str, ...]
    """b tasks whose things are looked for by their classes (`AugmentedSample.asked`)"""
    noise: int | None = None
    """seed of the noise on features; None for none"""


@dataclass(frozen=True)
class Batches:
    """Batches of a training; `batches(n)` computes batch n."""

    samples: Sequence[Item]
    sampler: BalancedSampler
    augmentation: Augmentation
    input_size: InputSize
    size: int
    """samples per batch"""
    seed: int
    coarse: int = 0
    """number of first batches with twice as many samples at half the size, which cost little more each"""

    def __call__(self, number: int) -> SampleBatch:
        """Compute batch `number`."""
        first, coarse = self.size * (number + min(number, self.coarse)), number < self.coarse
        samples = [self._sample(first + n) for n in range(2 * self.size if coarse else self.size)]
        made = collate(samples, self.input_size.half() if coarse else self.input_size)
        return made._replace(noise=derive_seed(self.seed, number))

    def _sample(self, position: int) -> AugmentedSample:
        _, index = self.sampler.sample(position)
        drawn, behind = np.random.default_rng((self.seed, position, 1)), None
        if self.augmentation.pasted_share and drawn.random() < self.augmentation.pasted_share:
            behind = self.samples[int(drawn.integers(len(self.samples)))].image
        return augment(self.samples[index], self.augmentation, self.seed, position, behind)


def collate(samples: Sequence[AugmentedSample], input_size: InputSize) -> SampleBatch:
    """Stack samples of any size into arrays at the input size of the model."""
    items = [one.item for one in samples]
    return SampleBatch(
        image=np.stack([input_size.image(item.image) for item in items]),
        masks=np.stack([input_size.masks(item.masks) for item in items]),
        task=tuple(item.narration for item in items),
        taxonomy=np.array([item.taxonomy for item in items], np.int64),
        centre=np.stack([one.centre for one in samples]),
        asked=tuple(one.asked for one in samples),
    )


TARGETS = {"affordance": slice(0, 2), "object": slice(2, 4)}
"""the two masks of a sample's four that are learned"""


class TwoHandsTask:
    """Two-hand model, its batches, losses and validation (`afford.training.job.Task`)."""

    monitor = "iou"

    def __init__(self, model: TwoHands, batches: Batches, validation: Sequence[SampleBatch], loss: LossParams, target: str,
                 device: str) -> None:
        """Set up the task; `validation` are batches without augmentation, `target` is one of `TARGETS`."""
        self.model: nn.Module = model
        self.batches, self.validation, self.params, self.device = batches, validation, loss, device
        self.target_masks = TARGETS[target]
        self._validated: list[ValidationSample] = []

    def batch(self, number: int) -> SampleBatch:
        """Compute micro-batch `number`."""
        return self.batches(number)

    def loss(self, model: nn.Module, batch: SampleBatch) -> dict[str, Tensor]:
        """Compute the losses by name."""
        return losses(model(self._input(batch)), self._target(batch), self.params)

    def validate(self) -> dict[str, float]:
        """Compute IoU and precision at the best threshold, taxonomy accuracy, and the loss, on the validation batches."""
        samples, totals = [], []
        for batch in self.validation:
            output = self.model(self._input(batch))
            totals.append(float(losses(output, self._target(batch), self.params)["total"]))
            samples += self._samples(output, batch)
        self._validated = samples
        return {**validation_metrics(samples), "total": float(np.mean(totals))}

    def preview(self, folder: Path, step: int) -> None:
        """Write a sheet of validation samples with the predictions of the last validation and the truth."""
        rows = [(image, task) for batch in self.validation for image, task in zip(batch.image, batch.task, strict=True)]
        write_preview(folder / f"step_{step:07d}.jpg", rows, self._validated)

    def _input(self, batch: SampleBatch) -> Batch:
        return Batch(stack_images(list(batch.image)).to(self.device), batch.task, batch.noise, batch.asked)

    def _target(self, batch: SampleBatch) -> Target:
        masks, things = (torch.from_numpy(batch.masks[:, part]).to(self.device) for part in (self.target_masks, TARGETS["object"]))
        taxonomy = torch.from_numpy(batch.taxonomy).to(self.device)
        centre = torch.from_numpy(batch.centre).to(self.device)
        return Target(masks.float(), masks.flatten(2).any(-1), taxonomy, things.float(), centre)

    def _samples(self, output: Output, batch: SampleBatch) -> list[ValidationSample]:
        """Predictions at the input size of the model, one for each sample."""
        size, truth = batch.masks.shape[-2:], batch.masks[:, self.target_masks]
        large = nn.functional.interpolate(output.logits.float().flatten(1, 2), size, mode="bilinear", align_corners=False)
        probability = large.sigmoid().unflatten(1, output.logits.shape[1:3]).cpu().numpy()
        score, taxonomy = output.score.float().cpu(), output.taxonomy.float().softmax(-1).cpu().numpy()
        rows = zip(probability, score, taxonomy, truth, batch.taxonomy, strict=True)
        return [ValidationSample.of(*row) for row in rows]


def validation_batches(samples: Sequence[AugmentedSample], input_size: InputSize, size: int) -> list[SampleBatch]:
    """Split samples, in order, into batches of at most `size`."""
    return [collate(samples[n : n + size], input_size) for n in range(0, len(samples), size)]
