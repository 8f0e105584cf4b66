"""Everything that decides a training of SOR3D-AFF's model."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from torch import nn

from afford.dataset import packed_sequences
from afford.rgbd.model import files, pretrain, vgg
from afford.rgbd.model.losses import LossParams
from afford.rgbd.model.model import Sor3d, build
from afford.rgbd.model.sequence_batches import SequenceBatches, fitted
from afford.rgbd.train import shares, sor3d_card
from afford.rgbd.train.interactions import Interactions
from afford.rgbd.train.sequences_job import SequencesJob, parts_of, spread
from schemas.files import FileTree


@dataclass(frozen=True)
class Sor3dJob(SequencesJob):
    """A training of the whole model on sequences and on their last frames."""

    JOB = "afford.rgbd.train.sor3d_job:Sor3dJob"
    WHAT = sor3d_card.WHAT

    loss: LossParams
    static_share: float
    """the last frames of this share of a micro-batch are learned beside it, as pictures"""
    coarse_share: float
    """share of the micro-batches that come first, at half the size: actions are learned there for a third of the price"""
    vgg: str
    """a VGG16 checkpoint for the stream of motion, '' for none"""
    encoder: str = ""
    """encoder.safetensors of a pre-training for the first stream, '' for none"""

    def starting_from(self, files: FileTree) -> Sor3dJob:
        """The same with the encoder that a pre-training left. ValueError when it left none."""
        found = files.find(f"model/{pretrain.FILE}")
        if found is None:
            raise ValueError(f"{files.name}: expected model/{pretrain.FILE} of a pre-training (sor3d_pretrain), found none")
        return replace(self, encoder=str(found.path.absolute()))

    def task(self, scratch: Path, processes: int) -> Interactions:
        """A new model, the batches of training and the sequences of validation."""
        parts = parts_of(scratch)
        model = build(self.config, self.seed)
        if self.config.norm == "batch":
            model.expect(shares.pixels(parts["train"], self.loss.foreground), shares.actions(parts["train"]))
        if self.encoder:
            pretrain.load(model.appearance, Path(self.encoder))
        if self.vgg and model.motion is not None:
            vgg.fill(model.motion, Path(self.vgg))
        total = self.plan.steps * self.plan.accumulate * processes
        batches = SequenceBatches(parts["train"], self.config, self.changes, self.order(parts["train"]), self.batch,
                                  self.static_share, total, self.seed, round(self.coarse_share * total))
        chosen = spread(parts["val"], self.val_samples)
        judged = [fitted(packed_sequences.read_sequence(path, self.config.flow), self.config.size_px) for path in chosen]
        return Interactions(model, batches, judged, self.loss, self.batch, self.plan.device)

    def save(self, model: nn.Module, folder: Path, scratch: Path) -> None:
        """config.json, model.safetensors."""
        assert isinstance(model, Sor3d)
        files.save(model, folder)
