"""The task of SOR3D-AFF's model: sequences in, the losses of `afford.models.sor3d` out."""

from __future__ import annotations

from collections.abc import Sequence as Listed
from pathlib import Path

import cv2
import numpy as np
import torch
from torch import Tensor, nn

from afford.common.image_files import jpeg
from afford.dataset.packed_sequences import PackedSequence
from afford.rgbd.evaluate import metrics as measures
from afford.rgbd.model.losses import LossParams, losses
from afford.rgbd.model.model import Said, Sor3d
from afford.rgbd.model.sequence_batches import Learned, SequenceBatches, last, stack
from schemas.interaction import AFFORDANCES, BACKGROUND, COLOURS_BGR

PREVIEWS, COLUMNS = 12, 4
OPACITY = 0.6


class Interactions:
    """What the loop trains (`afford.training.job.Task`). Videos judge; the same last frames as pictures are measured too."""

    monitor = "iou"

    def __init__(self, model: Sor3d, batches: SequenceBatches, judged: Listed[PackedSequence], loss: LossParams, size: int,
                 device: str) -> None:
        """`judged` are the sequences of validation, never changed, `size` of them at a time."""
        self.model: nn.Module = model
        self._net, self._batches, self._judged, self._loss, self._size, self._device = model, batches, judged, loss, size, device
        self._said: list[np.ndarray] = []

    def batch(self, number: int) -> Learned:
        """Micro-batch `number`."""
        return self._batches(number)

    def loss(self, model: nn.Module, batch: Learned) -> dict[str, Tensor]:
        """The losses by name."""
        said = model(*(frames.to(self._device) for frames in batch.groups))
        return losses(said, batch.label.to(self._device), batch.action.to(self._device), self._loss, batch.done)

    def validate(self) -> dict[str, float]:
        """IoU, F, weighted F and the share of right actions, of videos and, as static.*, of pictures; the loss of videos."""
        video, total, self._said = self._measured(self._judged)
        static, _, _ = self._measured([last(one) for one in self._judged])
        return {**video, **{f"static.{name}": value for name, value in static.items() if "." not in name}, "total": total}

    def preview(self, folder: Path, step: int) -> None:
        """A sheet of the first sequences: the last frame with what is true, below it with what was said of the video."""
        tiles = [np.vstack([tinted(one.rgb[-1], one.label), tinted(one.rgb[-1], said)])
                 for one, said in zip(self._judged[:PREVIEWS], self._said, strict=False)]  # fmt: skip
        tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % COLUMNS)
        (folder / f"step_{step:07d}.jpg").write_bytes(
            jpeg(np.vstack([np.hstack(tiles[n : n + COLUMNS]) for n in range(0, len(tiles), COLUMNS)]))
        )

    def _measured(self, judged: Listed[PackedSequence]) -> tuple[dict[str, float], float, list[np.ndarray]]:
        """Measures, mean loss, and the labels found."""
        found: list[np.ndarray] = []
        right, totals = [], []
        for n in range(0, len(judged), self._size):
            batch = stack([judged[n : n + self._size]], self._net.config)
            said: Said = self._net(batch.groups[0].to(self._device))
            truth = batch.label.to(self._device), batch.action.to(self._device)
            totals.append(float(losses(said, *truth, self._loss, 1.0)["total"]))
            found += list(said.logits.argmax(1).cpu().numpy().astype(np.uint8))
            right.append((said.action.argmax(1).cpu() == batch.action).float())
        of = measures.counts(np.stack(found), np.stack([one.label for one in judged]))
        return {**measures.summary(of), "action": float(torch.cat(right).mean())}, float(np.mean(totals)), found


def tinted(rgb: np.ndarray, label: np.ndarray) -> np.ndarray:
    """(h, w, 3) uint8 with the colours of the data set over what affords something."""
    colours = np.zeros((BACKGROUND + 1, 3), np.float32)
    colours[:BACKGROUND] = [COLOURS_BGR[name][::-1] for name in AFFORDANCES]
    weight = OPACITY * (label != BACKGROUND)[..., None].astype(np.float32)
    return cv2.convertScaleAbs(rgb * (1 - weight) + colours[label] * weight)
