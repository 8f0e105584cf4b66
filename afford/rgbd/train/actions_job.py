"""Everything that decides a pre-training of the first encoder of SOR3D-AFF's model."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from torch import nn

from afford.dataset.sor3d import sequences
from afford.rgbd.model import pretrain
from afford.rgbd.model.model import build
from afford.rgbd.train.actions import Actions, ClipBatches
from afford.rgbd.train.sequences_job import SequencesJob
from afford.rgbd.train.sor3d_job import job as sor3d
from afford.rgbd.train.sor3d_job import parts_of, spread
from afford.training.order import Order
from schemas.training import Recipe


class ActionsJob(SequencesJob):
    """A pre-training for the model of `whole`."""

    JOB = "afford.rgbd.train.actions_job:ActionsJob"
    WHAT = """The first encoder of SOR3D-AFF's spatio-temporal autoencoder with an LSTM, before the whole is trained. An RGB-D
sequence goes in; the action comes out."""

    def task(self, scratch: Path, processes: int) -> Actions:
        """The first encoder of a new model with an LSTM, and clips."""
        whole, parts = self.whole, parts_of(scratch)
        labels = [sequences.kind(path)[1] for path in parts["train"]]
        actions = tuple(sorted(set(labels)))
        model = pretrain.head(build(whole.config, whole.seed), len(actions), whole.seed)
        order = Order(labels, whole.balance, whole.seed)
        batches = ClipBatches(parts["train"], whole.config, whole.changes, order, whole.batch, actions, whole.seed)
        return Actions(model, batches, spread(parts["val"], whole.val_samples), whole.plan.device)

    def save(self, model: nn.Module, folder: Path, scratch: Path) -> None:
        """encoder.safetensors, which `model_train` (backend sor3d) starts from."""
        assert isinstance(model, pretrain.ActionLSTM)
        pretrain.save(model.encoder, folder)


def job(p: Any, recipe: Recipe | None, threads: int) -> ActionsJob:
    """What the stage's parameters `p` say."""
    return ActionsJob(sor3d(p, recipe, threads))
