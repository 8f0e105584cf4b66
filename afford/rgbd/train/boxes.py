"""The task of the detector that SOR3D-AFF's model is compared with: last frames in, boxes and masks out."""

from __future__ import annotations

from collections.abc import Sequence as Listed
from pathlib import Path

import numpy as np
from torch import Tensor, nn

from afford.common.image_files import jpeg
from afford.dataset.packed_sequences import PackedSequence
from afford.rgbd.boxes.losses import extents, losses
from afford.rgbd.boxes.model import Boxes, painted, proposals
from afford.rgbd.evaluate import metrics as measures
from afford.rgbd.model.sequence_batches import Learned, SequenceBatches, last, stack
from afford.rgbd.train.interactions import tinted

PREVIEWS, COLUMNS = 12, 4


class Detecting:
    """What the loop trains (`afford.training.job.Task`). What it says from its own boxes judges."""

    monitor = "iou"

    def __init__(self, model: Boxes, batches: SequenceBatches, judged: Listed[PackedSequence], device: str) -> None:
        """`judged` are the sequences of validation; their last frames are looked at."""
        self.model: nn.Module = model
        self._net, self._batches, self._device = model, batches, device
        self._judged = [last(one) for one in judged]
        self._said: list[np.ndarray] = []

    def batch(self, number: int) -> Learned:
        """Micro-batch `number`: last frames."""
        return stack([[last(one) for one in self._batches.drawn(number)]], self._net.config)

    def loss(self, model: nn.Module, batch: Learned) -> dict[str, Tensor]:
        """The losses by name. `model` may be wrapped: masks are asked of what is inside."""
        return losses(self._net, model(batch.groups[0].to(self._device)), batch.label.to(self._device))

    def validate(self) -> dict[str, float]:
        """IoU, F, weighted F from own boxes; the same, as true_boxes.*, when the boxes are told; the loss."""
        own, told, totals = list[np.ndarray](), list[np.ndarray](), list[float]()
        for one in self._judged:
            batch = stack([[one]], self._net.config)
            label = batch.label.to(self._device)
            seen = self._net(batch.groups[0].to(self._device))
            totals.append(float(losses(self._net, seen, label)["total"]))
            for boxes, said in ((proposals(seen, 0), own), (extents(label)[0], told)):
                size = (label.shape[1], label.shape[2])
                said.append(painted(self._net, seen.features, boxes, size).argmax(0).cpu().numpy().astype(np.uint8))
        self._said, truth = own, np.stack([one.label for one in self._judged])
        free, helped = (measures.summary(measures.counts(np.stack(said), truth)) for said in (own, told))
        return {**free, **{f"true_boxes.{name}": value for name, value in helped.items() if "." not in name},
                "total": float(np.mean(totals))}  # fmt: skip

    def preview(self, folder: Path, step: int) -> None:
        """A sheet of the first pictures: what is true, below it what was said from own boxes."""
        tiles = [np.vstack([tinted(one.rgb[-1], one.label), tinted(one.rgb[-1], said)])
                 for one, said in zip(self._judged[:PREVIEWS], self._said, strict=False)]  # fmt: skip
        tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % COLUMNS)
        rows = [np.hstack(tiles[n : n + COLUMNS]) for n in range(0, len(tiles), COLUMNS)]
        (folder / f"step_{step:07d}.jpg").write_bytes(jpeg(np.vstack(rows)))
