"""What a training leaves: the folder of model, card, curves and pictures."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from afford.codecs.kinds import digest
from afford.common.files import empty_folder
from afford.training.fit import Fitted
from afford.training.job import Job
from afford.training.task import Batch
from schemas.files import FileTree
from schemas.training import TrainingLog

MODEL, CARD, HISTORY = "model", "card.md", "history.parquet"


class Source(NamedTuple):
    """A data set as a whole (`afford.training.job.Dataset`)."""

    name: str
    digest: str
    licence: str


def write(scratch: Path, name: str, dataset: FileTree, job: Job[Batch], fitted: Fitted,
          curves: TrainingLog) -> Path:  # fmt: skip
    """The folder of files; everything in it is a function of the data set, the job and the weights."""
    root = empty_folder(scratch / "out")
    job.save(fitted.model, root / MODEL, scratch)
    for folder in ("tensorboard", "previews"):
        if (scratch / folder).exists():
            shutil.copytree(scratch / folder, root / folder)
    _history(curves, root / HISTORY)
    source = Source(dataset.name, digest(dataset), _licence(dataset))
    text = job.card(name, source, scratch, fitted.model, curves)
    (root / CARD).write_text(text, encoding="utf-8", newline="\n")
    return root


def _history(curves: TrainingLog, path: Path) -> None:
    """One row per point: step, name, value; by name, then step."""
    table = pa.table({
        "step": np.concatenate([curve.step for curve in curves.curves]),
        "name": [curve.name for curve in curves.curves for _ in curve.step],
        "value": np.concatenate([curve.value for curve in curves.curves]),
    })
    pq.write_table(table, path, compression="zstd")


def _licence(dataset: FileTree) -> str:
    """The licence on the data set's own card, 'unknown' where it says none."""
    found = dataset.find("README.md")
    line = re.search(r"^license: *(\S+)", found.path.read_text(encoding="utf-8"), re.MULTILINE) if found else None
    return line[1] if line else "unknown"
