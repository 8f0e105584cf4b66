"""Files of a finished training: model, card, history of curves, TensorBoard events and previews."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from torch import nn

from afford.codecs.kinds import digest
from afford.common.files import empty_folder
from afford.training.job import Batch, Job
from schemas.files import FileTree
from schemas.training import TrainingLog

MODEL, CARD, HISTORY = "model", "card.md", "history.parquet"


class Source(NamedTuple):
    """Facts about the data set that the card reports (`afford.training.job.Dataset`)."""

    name: str
    digest: str
    licence: str


def write_artifacts(scratch: Path, name: str, dataset: FileTree, job: Job[Batch], model: nn.Module,
                    curves: TrainingLog) -> Path:  # fmt: skip
    """Write the folder of files; its contents are a function of the data set, the job and the weights."""
    root = empty_folder(scratch / "out")
    job.save(model, root / MODEL, scratch)
    for folder in ("tensorboard", "previews"):
        if (scratch / folder).exists():
            shutil.copytree(scratch / folder, root / folder)
    _history(curves, root / HISTORY)
    source = Source(dataset.name, digest(dataset), _licence(dataset))
    text = job.card(name, source, scratch, model, curves)
    (root / CARD).write_text(text, encoding="utf-8", newline="\n")
    return root


def _history(curves: TrainingLog, path: Path) -> None:
    """Write one row (step, name, value) per point, sorted by name, then step."""
    table = pa.table({
        "step": np.concatenate([curve.step for curve in curves.curves]),
        "name": [curve.name for curve in curves.curves for _ in curve.step],
        "value": np.concatenate([curve.value for curve in curves.curves]),
    })
    pq.write_table(table, path, compression="zstd")


def _licence(dataset: FileTree) -> str:
    """Licence on the data set's own card, 'unknown' when it has none."""
    found = dataset.find("README.md")
    line = re.search(r"^license: *(\S+)", found.path.read_text(encoding="utf-8"), re.MULTILINE) if found else None
    return line[1] if line else "unknown"
