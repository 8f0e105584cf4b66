"""Everything that decides a training of the detector that SOR3D-AFF's model is compared with on single pictures."""

from __future__ import annotations

from pathlib import Path

from torch import nn

from afford.dataset import packed_sequences
from afford.rgbd.boxes.model import FORMAT, Boxes, build
from afford.rgbd.model import files
from afford.rgbd.model.sequence_batches import SequenceBatches, fitted
from afford.rgbd.train.boxes import Detecting
from afford.rgbd.train.sequences_job import SequencesJob, parts_of, spread

EVERY = 1.0
"""share of a batch whose last frames are learned, as pictures"""


class BoxesJob(SequencesJob):
    """A training on the last frames of sequences."""

    JOB = "afford.rgbd.train.boxes_job:BoxesJob"
    WHAT = """A detector after AffordanceNet (Do, Nguyen and Reid 2018), for comparison: an encoder like that of SOR3D-AFF's model,
boxes of things, and inside each box a mask of affordances. One picture goes in. Boxes were learned from the extent of labels."""

    def task(self, scratch: Path, processes: int) -> Detecting:
        """A new model, batches of last frames, and those that judge."""
        parts = parts_of(scratch)
        total = self.plan.steps * self.plan.accumulate * processes
        batches = SequenceBatches(parts["train"], self.config, self.changes, self.order(parts["train"]), self.batch, EVERY, total,
                                  self.seed)
        judged = [fitted(packed_sequences.read_sequence(path, "none"), self.config.size_px)
                  for path in spread(parts["val"], self.val_samples)]  # fmt: skip
        return Detecting(build(self.config, self.seed), batches, judged, self.plan.device)

    def save(self, model: nn.Module, folder: Path, scratch: Path) -> None:
        """config.json, model.safetensors."""
        assert isinstance(model, Boxes)
        files.save(model, folder, FORMAT)
