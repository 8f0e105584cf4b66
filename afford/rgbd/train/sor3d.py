"""Training of SOR3D-AFF's model: its task (losses, validation, previews), its job, and class frequencies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import torch
from torch import Tensor, nn

from afford.common.image_files import jpeg
from afford.dataset import packed_sequences
from afford.dataset.packed_sequences import PackedSequence
from afford.rgbd.evaluate import metrics
from afford.rgbd.model import checkpoint
from afford.rgbd.model.losses import LossParams, losses
from afford.rgbd.model.model import Sor3d, Sor3dOutput, build
from afford.rgbd.model.model_inputs import SequenceBatches, TrainingBatch, fit_to_model, last_frame, stack
from afford.rgbd.train import job
from afford.rgbd.train.job import SequencesJob, split_paths, spread_evenly
from schemas.files import FileTree
from schemas.interaction import AFFORDANCES, BACKGROUND, COLOURS_BGR

PREVIEWS, COLUMNS = 12, 4
OPACITY = 0.6


class Sor3dTask:
    """Task of the training loop (`afford.training.job.Task`); videos decide, their last frames as pictures are measured too."""

    monitor = "iou"

    def __init__(self, model: Sor3d, batches: SequenceBatches, validation: Sequence[PackedSequence], loss: LossParams,
                 size: int, device: str) -> None:  # fmt: skip
        """`validation` are the sequences of validation, never augmented, evaluated `size` at a time."""
        self.model: nn.Module = model
        self._net, self._batches, self._validation, self._device = model, batches, validation, device
        self._loss, self._size = loss, size
        self._predicted: list[np.ndarray] = []

    def batch(self, number: int) -> TrainingBatch:
        """Micro-batch `number`."""
        return self._batches(number)

    def loss(self, model: nn.Module, batch: TrainingBatch) -> dict[str, Tensor]:
        """Losses by name."""
        output = model(*(frames.to(self._device) for frames in batch.groups))
        return losses(output, batch.label.to(self._device), batch.action.to(self._device), self._loss, batch.done)

    def validate(self) -> dict[str, float]:
        """IoU, F, weighted F and action accuracy of videos and, as static.*, of pictures; loss of videos."""
        video, total, self._predicted = self._measured(self._validation)
        static, _, _ = self._measured([last_frame(one) for one in self._validation])
        return {**video, **{f"static.{name}": value for name, value in static.items() if "." not in name}, "total": total}

    def preview(self, folder: Path, step: int) -> None:
        """Write a sheet of the first sequences: last frame with the truth above, with the prediction of the video below."""
        tiles = [np.vstack([tint_labels(one.rgb[-1], one.label), tint_labels(one.rgb[-1], label)])
                 for one, label in zip(self._validation[:PREVIEWS], self._predicted, strict=False)]  # fmt: skip
        tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % COLUMNS)
        (folder / f"step_{step:07d}.jpg").write_bytes(
            jpeg(np.vstack([np.hstack(tiles[n : n + COLUMNS]) for n in range(0, len(tiles), COLUMNS)]))
        )

    def _measured(self, validation: Sequence[PackedSequence]) -> tuple[dict[str, float], float, list[np.ndarray]]:
        """Metrics, mean loss, and predicted labels."""
        found: list[np.ndarray] = []
        right, totals = [], []
        for n in range(0, len(validation), self._size):
            batch = stack([validation[n : n + self._size]], self._net.config)
            output: Sor3dOutput = self._net(batch.groups[0].to(self._device))
            truth = batch.label.to(self._device), batch.action.to(self._device)
            totals.append(float(losses(output, *truth, self._loss, 1.0)["total"]))
            found += list(output.logits.argmax(1).cpu().numpy().astype(np.uint8))
            right.append((output.action.argmax(1).cpu() == batch.action).float())
        of = metrics.counts(np.stack(found), np.stack([one.label for one in validation]))
        return {**metrics.summary(of), "action": float(torch.cat(right).mean())}, float(np.mean(totals)), found


def tint_labels(rgb: np.ndarray, label: np.ndarray) -> np.ndarray:
    """Picture (h, w, 3) uint8 with the data set's colours over its affordances."""
    colours = np.zeros((BACKGROUND + 1, 3), np.float32)
    colours[:BACKGROUND] = [COLOURS_BGR[name][::-1] for name in AFFORDANCES]
    weight = OPACITY * (label != BACKGROUND)[..., None].astype(np.float32)
    return cv2.convertScaleAbs(rgb * (1 - weight) + colours[label] * weight)


@dataclass(frozen=True)
class Sor3dJob(SequencesJob):
    """Training of the whole model on sequences and on their last frames."""

    JOB = "afford.rgbd.train.sor3d:Sor3dJob"
    WHAT = job.WHAT

    loss: LossParams
    static_share: float
    """share of a micro-batch whose last frames are added as pictures"""
    coarse_share: float
    """share of the first micro-batches, at half the size: actions are learned there at a third of the cost"""
    vgg: str
    """VGG16 checkpoint for the stream of motion, '' for none"""
    encoder: str = ""
    """encoder.safetensors of a pre-training for the first stream, '' for none"""

    def starting_from(self, files: FileTree) -> Sor3dJob:
        """Job that starts from the encoder of a pre-training. ValueError when the files have none."""
        found = files.find(f"model/{checkpoint.ENCODER}")
        if found is None:
            raise ValueError(f"{files.name}: it has no model/{checkpoint.ENCODER}; give the files of sor3d_pretrain")
        return replace(self, encoder=str(found.path.absolute()))

    def task(self, scratch: Path, processes: int) -> Sor3dTask:
        """Build the model, its training batches and the sequences of validation."""
        parts = split_paths(scratch)
        model = build(self.config, self.seed)
        if self.config.norm == "batch":
            model.init_class_priors(pixel_frequencies(parts["train"], self.loss.foreground), action_frequencies(parts["train"]))
        if self.encoder:
            checkpoint.load_encoder(model.appearance, Path(self.encoder))
        if self.vgg and model.motion is not None:
            checkpoint.load_vgg16(model.motion, Path(self.vgg))
        total = self.plan.steps * self.plan.accumulate * processes
        batches = SequenceBatches(parts["train"], self.config, self.changes, self.order(parts["train"]), self.batch,
                                  self.static_share, total, self.seed, round(self.coarse_share * total))
        chosen = spread_evenly(parts["val"], self.val_samples)
        validation = [fit_to_model(packed_sequences.read_sequence(path, self.config.flow), self.config.size_px) for path in chosen]
        return Sor3dTask(model, batches, validation, self.loss, self.batch, self.plan.device)

    def save(self, model: nn.Module, folder: Path, scratch: Path) -> None:
        """Write config.json and model.safetensors."""
        assert isinstance(model, Sor3d)
        checkpoint.save_model(model, folder)


UNSEEN = 0.5
"""count of a class that does not occur"""


def pixel_frequencies(paths: Sequence[Path], foreground: float) -> Tensor:
    """Class frequencies (10,) of pixels, affordances weighted by `foreground`; they sum to 1."""
    labels = (packed_sequences.read_label(path) for path in paths)
    counts = np.sum([np.bincount(label.ravel(), minlength=BACKGROUND + 1) for label in labels], axis=0).astype(float)
    counts[:BACKGROUND] *= foreground
    return _frequencies(counts)


def action_frequencies(paths: Sequence[Path]) -> Tensor:
    """Class frequencies (9,) of sequences; they sum to 1."""
    found = [packed_sequences.affordance_index(packed_sequences.read_classes(path)[1]) for path in paths]
    return _frequencies(np.bincount(found, minlength=len(AFFORDANCES)).astype(float))


def _frequencies(counts: np.ndarray) -> Tensor:
    some = np.maximum(counts, UNSEEN)
    return torch.from_numpy(some / some.sum()).float()
