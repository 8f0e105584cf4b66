"""the curves of a training, and its pictures -> its recording.

Reads   TrainingLog; FileTree of the same training, for the previews
Writes  FileTree of one file, <name>.mcap: a topic per curve with flat doubles, the previews as pictures
Method  log time is the fixed base of all recordings, a millisecond per step
Fails   when the training measured nothing
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.spec import Context
from schemas.training import TrainingLog

LIBRARIES = ("numpy", "opencv-python-headless", "mcap", "mcap-protobuf-support", "foxglove-schemas-protobuf", "protobuf",
             "zstandard", "blake3")  # fmt: skip
THREADS = 1
MEMORY_GIB = 0.5


@dataclass(frozen=True)
class Params:
    """Nothing to choose."""


def run(log: TrainingLog, files: FileTree, params: Params, ctx: Context) -> FileTree:
    """Write the recording of one training; ValueError when there is no curve."""
    from afford.recording.files import as_tree, write
    from afford.recording.of_training import record
    from afford.recording.provenance import of_files

    if not log.curves:
        raise ValueError(f"{log.name}: expected curves to record, got none")
    path = ctx.scratch / f"{log.name}.mcap"
    write(path, of_files(record(log, files), "model_train", files))
    return as_tree(log.name, path)
