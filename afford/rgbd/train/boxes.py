"""Training of the box detector that SOR3D-AFF's model is compared with on single pictures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from torch import Tensor, nn

from afford.common.image_files import jpeg
from afford.dataset import packed_sequences
from afford.dataset.packed_sequences import PackedSequence
from afford.rgbd.evaluate import metrics
from afford.rgbd.model import checkpoint
from afford.rgbd.model.detector import FORMAT, BoxDetector, build, detector_losses, label_boxes, nms_proposals, paste_masks
from afford.rgbd.model.model_inputs import SequenceBatches, TrainingBatch, fit_to_model, last_frame, stack
from afford.rgbd.train.job import SequencesJob, split_paths, spread_evenly
from afford.rgbd.train.sor3d import tint_labels

PREVIEWS, COLUMNS = 12, 4


class DetectorTask:
    """Task of the training loop (`afford.training.job.Task`); predictions from the detector's own boxes decide."""

    monitor = "iou"

    def __init__(self, model: BoxDetector, batches: SequenceBatches, validation: Sequence[PackedSequence], device: str) -> None:
        """`validation` are the sequences of validation; their last frames are used."""
        self.model: nn.Module = model
        self._net, self._batches, self._device = model, batches, device
        self._validation = [last_frame(one) for one in validation]
        self._predicted: list[np.ndarray] = []

    def batch(self, number: int) -> TrainingBatch:
        """Micro-batch `number` of last frames."""
        return stack([[last_frame(one) for one in self._batches.sequences_of(number)]], self._net.config)

    def loss(self, model: nn.Module, batch: TrainingBatch) -> dict[str, Tensor]:
        """Losses by name. `model` may be a wrapper; masks are computed by the detector itself."""
        return detector_losses(self._net, model(batch.groups[0].to(self._device)), batch.label.to(self._device))

    def validate(self) -> dict[str, float]:
        """IoU, F, weighted F from the detector's own boxes; the same from true boxes as true_boxes.*; the loss."""
        own, given, totals = list[np.ndarray](), list[np.ndarray](), list[float]()
        for one in self._validation:
            batch = stack([[one]], self._net.config)
            label = batch.label.to(self._device)
            seen = self._net(batch.groups[0].to(self._device))
            totals.append(float(detector_losses(self._net, seen, label)["total"]))
            for boxes, labels in ((nms_proposals(seen, 0), own), (label_boxes(label)[0], given)):
                size = (label.shape[1], label.shape[2])
                labels.append(paste_masks(self._net, seen.features, boxes, size).argmax(0).cpu().numpy().astype(np.uint8))
        self._predicted, truth = own, np.stack([one.label for one in self._validation])
        free, helped = (metrics.summary(metrics.counts(np.stack(labels), truth)) for labels in (own, given))
        return {**free, **{f"true_boxes.{name}": value for name, value in helped.items() if "." not in name},
                "total": float(np.mean(totals))}  # fmt: skip

    def preview(self, folder: Path, step: int) -> None:
        """Write a sheet of the first pictures: truth above, prediction from own boxes below."""
        tiles = [np.vstack([tint_labels(one.rgb[-1], one.label), tint_labels(one.rgb[-1], labels)])
                 for one, labels in zip(self._validation[:PREVIEWS], self._predicted, strict=False)]  # fmt: skip
        tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % COLUMNS)
        rows = [np.hstack(tiles[n : n + COLUMNS]) for n in range(0, len(tiles), COLUMNS)]
        (folder / f"step_{step:07d}.jpg").write_bytes(jpeg(np.vstack(rows)))


EVERY = 1.0
"""share of a batch whose last frames are used as pictures"""


class BoxesJob(SequencesJob):
    """Training of the detector on the last frames of sequences."""

    JOB = "afford.rgbd.train.boxes:BoxesJob"
    WHAT = """A detector after AffordanceNet (Do, Nguyen and Reid 2018), for comparison: an encoder like that of SOR3D-AFF's model,
boxes of things, and inside each box a mask of affordances. One picture goes in. Boxes were learned from the extent of labels."""

    def task(self, scratch: Path, processes: int) -> DetectorTask:
        """Build the detector, batches of last frames, and the pictures of validation."""
        parts = split_paths(scratch)
        total = self.plan.steps * self.plan.accumulate * processes
        batches = SequenceBatches(parts["train"], self.config, self.changes, self.order(parts["train"]), self.batch, EVERY, total,
                                  self.seed)
        chosen = spread_evenly(parts["val"], self.val_samples)
        validation = [fit_to_model(packed_sequences.read_sequence(path, "none"), self.config.size_px) for path in chosen]
        return DetectorTask(build(self.config, self.seed), batches, validation, self.plan.device)

    def save(self, model: nn.Module, folder: Path, scratch: Path) -> None:
        """Write config.json and model.safetensors."""
        assert isinstance(model, BoxDetector)
        checkpoint.save_model(model, folder, FORMAT)
