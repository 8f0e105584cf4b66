"""Everything that decides a training of the detector that SOR3D-AFF's model is compared with on single pictures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from torch import nn

from afford.dataset.sor3d import sequences
from afford.rgbd.boxes.model import FORMAT, Boxes, build
from afford.rgbd.model import files
from afford.rgbd.model.sequence_batches import SequenceBatches, fitted
from afford.rgbd.train.boxes import Detecting
from afford.rgbd.train.sequences_job import SequencesJob
from afford.rgbd.train.sor3d_job import job as sor3d
from afford.rgbd.train.sor3d_job import parts_of, spread
from afford.training.order import Order
from schemas.training import Recipe


class BoxesJob(SequencesJob):
    """A training on the last frames of what `whole` would learn from."""

    JOB = "afford.rgbd.train.boxes_job:BoxesJob"
    WHAT = """A detector after AffordanceNet (Do, Nguyen and Reid 2018), for comparison: an encoder like that of SOR3D-AFF's model,
boxes of things, and inside each box a mask of affordances. One picture goes in. Boxes were learned from the extent of labels."""

    def task(self, scratch: Path, processes: int) -> Detecting:
        """A new model, batches of last frames, and those that judge."""
        whole, parts = self.whole, parts_of(scratch)
        order = Order([sequences.kind(path) for path in parts["train"]], whole.balance, whole.seed)
        total = whole.plan.steps * whole.plan.accumulate * processes
        batches = SequenceBatches(parts["train"], whole.config, whole.changes, order, whole.batch, 1.0, total, whole.seed)
        judged = [fitted(sequences.read(path, "none"), whole.config.size_px) for path in spread(parts["val"], whole.val_samples)]
        return Detecting(build(whole.config, whole.seed), batches, judged, whole.plan.device)

    def save(self, model: nn.Module, folder: Path, scratch: Path) -> None:
        """config.json, model.safetensors."""
        assert isinstance(model, Boxes)
        files.save(model, folder, FORMAT)


def job(p: Any, recipe: Recipe | None, threads: int) -> BoxesJob:
    """What the stage's parameters `p` say: of the row, whether depth is seen. ValueError for a GPU, which has no kernel that learns
    through samples inside of boxes and gives the same result twice."""
    if p.device != "cpu":
        raise ValueError(f"model_train: expected device=cpu for the detector (backend=boxes), got {p.device!r}; it takes minutes")
    whole = sor3d(p, recipe, threads)
    return BoxesJob(replace(whole, config=replace(whole.config, flow="none", attention=False), static_share=1.0))
