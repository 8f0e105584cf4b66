"""The task of pre-training: clips in, the action out; what is wanted is the encoder."""

from __future__ import annotations

from collections.abc import Sequence as Listed
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import cross_entropy

from afford.dataset import packed_sequences
from afford.dataset.packed_sequences import PackedSequence
from afford.rgbd.model.config import Sor3dConfig
from afford.rgbd.model.inputs import Seen, frames
from afford.rgbd.model.pretrain import ActionLSTM
from afford.rgbd.model.sequence_batches import Changes, changed, fitted
from afford.training.sampler import BalancedSampler

FRAMES = 10
"""frames that are seen of a clip, spread over it"""


class Clips(NamedTuple):
    """b clips."""

    appearance: Tensor
    """(b, t, 3 or 4, h, w) float32"""
    action: Tensor
    """(b,) int64"""


@dataclass(frozen=True)
class ClipBatches:
    """`batches(n)` is batch n."""

    paths: Listed[Path]
    config: Sor3dConfig
    changes: Changes
    order: BalancedSampler
    size: int
    actions: tuple[str, ...]
    seed: int

    def __call__(self, number: int) -> Clips:
        return self.stack([self._sample(number * self.size + n) for n in range(self.size)])

    def _sample(self, position: int) -> PackedSequence:
        _, index = self.order.sample(position)
        rng = np.random.default_rng((self.seed, position, 3))
        return changed(self.read(self.paths[index], rng.random()), self.changes, rng)

    def read(self, path: Path, phase: float) -> PackedSequence:
        """A clip at the size of the model, `FRAMES` of its frames from `phase` 0..1 on."""
        one = fitted(packed_sequences.read_sequence(path, "none"), self.config.size_px)
        chosen = ((np.arange(FRAMES) + phase) * len(one.rgb) / FRAMES).astype(int)
        return replace(one, rgb=one.rgb[chosen], depth_m=one.depth_m[chosen])

    def stack(self, chosen: Listed[PackedSequence]) -> Clips:
        """ValueError for an action that training does not show."""
        unknown = {one.affordance for one in chosen} - set(self.actions)
        if unknown:
            raise ValueError(f"actions: expected those of training ({', '.join(self.actions)}), got {', '.join(sorted(unknown))}")
        appearance = frames([Seen(one.rgb, one.depth_m, one.flow, one.still) for one in chosen], self.config).appearance
        return Clips(appearance if self.config.depth else appearance[:, :, :3],
                     torch.tensor([self.actions.index(one.affordance) for one in chosen]))  # fmt: skip


class Actions:
    """What the loop trains (`afford.training.job.Task`)."""

    monitor = "action"

    def __init__(self, model: ActionLSTM, batches: ClipBatches, judged: Listed[Path], device: str) -> None:
        self.model: nn.Module = model
        self._batches, self._judged, self._device = batches, judged, device

    def batch(self, number: int) -> Clips:
        """Micro-batch `number`."""
        return self._batches(number)

    def loss(self, model: nn.Module, batch: Clips) -> dict[str, Tensor]:
        """Cross-entropy of the action."""
        return {"total": cross_entropy(model(batch.appearance.to(self._device)).float(), batch.action.to(self._device))}

    def validate(self) -> dict[str, float]:
        """Share of clips whose action is told, and the loss."""
        right, totals = [], []
        for path in self._judged:
            batch = self._batches.stack([self._batches.read(path, 0.5)])
            said, truth = self.model(batch.appearance.to(self._device)).float(), batch.action.to(self._device)
            right.append(float(said.argmax(1) == truth))
            totals.append(float(cross_entropy(said, truth)))
        return {"action": float(np.mean(right)), "total": float(np.mean(totals))}

    def preview(self, folder: Path, step: int) -> None:
        """Nothing to see."""
