"""Pre-training of the first stream: its encoder with an LSTM classifies the action of a clip (SOR3D-AFF: 50 epochs, UTKinect)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import cross_entropy

from afford.dataset import packed_sequences
from afford.dataset.packed_sequences import PackedSequence
from afford.rgbd.model import checkpoint
from afford.rgbd.model.config import Sor3dConfig
from afford.rgbd.model.layers import Encoder, init_xavier
from afford.rgbd.model.model import Sor3d, build
from afford.rgbd.model.model_inputs import Augmentation, ModelInput, augment, fit_to_model, to_batch
from afford.rgbd.train.job import SequencesJob, split_paths, spread_evenly
from afford.training.sampler import BalancedSampler

FRAMES = 10
"""frames of a clip that are used, spread over it"""


class ClipBatch(NamedTuple):
    """b clips."""

    appearance: Tensor
    """(b, t, 3 or 4, h, w) float32"""
    action: Tensor
    """(b,) int64"""


@dataclass(frozen=True)
class ClipBatches:
    """Training batches of clips: `batches(n)` is batch n."""

    paths: Sequence[Path]
    config: Sor3dConfig
    changes: Augmentation
    order: BalancedSampler
    size: int
    actions: tuple[str, ...]
    seed: int

    def __call__(self, number: int) -> ClipBatch:
        """Batch `number`."""
        return self.stack([self._sample(number * self.size + n) for n in range(self.size)])

    def _sample(self, position: int) -> PackedSequence:
        _, index = self.order.sample(position)
        rng = np.random.default_rng((self.seed, position, 3))
        return augment(self.read(self.paths[index], rng.random()), self.changes, rng)

    def read(self, path: Path, phase: float) -> PackedSequence:
        """Clip at the size of the model: `FRAMES` of its frames, offset by `phase` 0..1."""
        one = fit_to_model(packed_sequences.read_sequence(path, "none"), self.config.size_px)
        chosen = ((np.arange(FRAMES) + phase) * len(one.rgb) / FRAMES).astype(int)
        return replace(one, rgb=one.rgb[chosen], depth_m=one.depth_m[chosen])

    def stack(self, chosen: Sequence[PackedSequence]) -> ClipBatch:
        """Stack clips. ValueError for an action that training does not have."""
        unknown = {one.affordance for one in chosen} - set(self.actions)
        if unknown:
            raise ValueError(f"actions: expected those of training ({', '.join(self.actions)}), got {', '.join(sorted(unknown))}")
        appearance = to_batch([ModelInput(one.rgb, one.depth_m, one.flow, one.still) for one in chosen], self.config).appearance
        return ClipBatch(appearance if self.config.depth else appearance[:, :, :3],
                     torch.tensor([self.actions.index(one.affordance) for one in chosen]))  # fmt: skip


class ActionTask:
    """Task of the training loop (`afford.training.job.Task`)."""

    monitor = "action"

    def __init__(self, model: ActionLSTM, batches: ClipBatches, validation: Sequence[Path], device: str) -> None:
        self.model: nn.Module = model
        self._batches, self._validation, self._device = batches, validation, device

    def batch(self, number: int) -> ClipBatch:
        """Micro-batch `number`."""
        return self._batches(number)

    def loss(self, model: nn.Module, batch: ClipBatch) -> dict[str, Tensor]:
        """Cross-entropy of the action."""
        return {"total": cross_entropy(model(batch.appearance.to(self._device)).float(), batch.action.to(self._device))}

    def validate(self) -> dict[str, float]:
        """Action accuracy and loss."""
        right, totals = [], []
        for path in self._validation:
            batch = self._batches.stack([self._batches.read(path, 0.5)])
            logits, truth = self.model(batch.appearance.to(self._device)).float(), batch.action.to(self._device)
            right.append(float(logits.argmax(1) == truth))
            totals.append(float(cross_entropy(logits, truth)))
        return {"action": float(np.mean(right)), "total": float(np.mean(totals))}

    def preview(self, folder: Path, step: int) -> None:
        """Write no preview."""


class ActionLSTM(nn.Module):
    """Action classifier: encoder, mean over positions, LSTM over frames, linear layer on its last state."""

    def __init__(self, encoder: Encoder, width: int, actions: int) -> None:
        super().__init__()
        self.encoder = encoder
        self.lstm = nn.LSTM(width, width, batch_first=True)
        self.action = nn.Linear(width, actions)

    def forward(self, appearance: Tensor) -> Tensor:
        """Classify (n, t, c, h, w) as logits (n, actions)."""
        count, steps = appearance.shape[:2]
        features = self.encoder(appearance.flatten(0, 1))[-1].mean((-2, -1)).unflatten(0, (count, steps))
        found: Tensor = self.action(self.lstm(features)[0][:, -1])
        return found


def action_classifier(model: Sor3d, actions: int, seed: int) -> ActionLSTM:
    """Classifier around the first stream of `model` itself: training it trains the stream."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        made = ActionLSTM(Encoder(1, (1, 1, 1, 1), "none"), model.config.widths[-1], actions)
        init_xavier(made)
        made.encoder = model.appearance
    return made


class ActionsJob(SequencesJob):
    """Pre-training of the first stream of the model of `config`."""

    JOB = "afford.rgbd.train.actions:ActionsJob"
    WHAT = """The first encoder of SOR3D-AFF's spatio-temporal autoencoder with an LSTM, before the whole is trained. An RGB-D
sequence goes in; the action comes out."""

    def task(self, scratch: Path, processes: int) -> ActionTask:
        """Build a classifier around the first encoder of a new model, and batches of clips."""
        parts = split_paths(scratch)
        labels = [packed_sequences.read_classes(path)[1] for path in parts["train"]]
        actions = tuple(sorted(set(labels)))
        model = action_classifier(build(self.config, self.seed), len(actions), self.seed)
        order = BalancedSampler(labels, self.balance, self.seed)
        batches = ClipBatches(parts["train"], self.config, self.changes, order, self.batch, actions, self.seed)
        return ActionTask(model, batches, spread_evenly(parts["val"], self.val_samples), self.plan.device)

    def save(self, model: nn.Module, folder: Path, scratch: Path) -> None:
        """Write encoder.safetensors, the start of `sor3d_train`."""
        assert isinstance(model, ActionLSTM)
        checkpoint.save_encoder(model.encoder, folder)
