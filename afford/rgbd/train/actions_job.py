"""Everything that decides a pre-training of the first encoder of SOR3D-AFF's model."""

from __future__ import annotations

from pathlib import Path

from torch import nn

from afford.dataset import packed_sequences
from afford.rgbd.model import pretrain
from afford.rgbd.model.model import build
from afford.rgbd.train.actions import Actions, ClipBatches
from afford.rgbd.train.sequences_job import SequencesJob, parts_of, spread
from afford.training.sampler import BalancedSampler


class ActionsJob(SequencesJob):
    """A pre-training for the model of `config`."""

    JOB = "afford.rgbd.train.actions_job:ActionsJob"
    WHAT = """The first encoder of SOR3D-AFF's spatio-temporal autoencoder with an LSTM, before the whole is trained. An RGB-D
sequence goes in; the action comes out."""

    def task(self, scratch: Path, processes: int) -> Actions:
        """The first encoder of a new model with an LSTM, and clips."""
        parts = parts_of(scratch)
        labels = [packed_sequences.read_classes(path)[1] for path in parts["train"]]
        actions = tuple(sorted(set(labels)))
        model = pretrain.head(build(self.config, self.seed), len(actions), self.seed)
        order = BalancedSampler(labels, self.balance, self.seed)
        batches = ClipBatches(parts["train"], self.config, self.changes, order, self.batch, actions, self.seed)
        return Actions(model, batches, spread(parts["val"], self.val_samples), self.plan.device)

    def save(self, model: nn.Module, folder: Path, scratch: Path) -> None:
        """encoder.safetensors, which `sor3d_train` starts from."""
        assert isinstance(model, pretrain.ActionLSTM)
        pretrain.save(model.encoder, folder)
