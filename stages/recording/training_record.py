"""Record a training: its curves and previews.

Reads   TrainingLog; FileTree of the same training, for the previews
Writes  FileTree of one file, <name>.mcap: a topic per curve with flat doubles, the previews as pictures, the parameters
Method  log time is the fixed base of all recordings plus a millisecond per step
Fails   when the training has no curve
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
    """Parameters of `training_record`."""

    stage: str = "model_train"
    """stage that trained; its name is the first word of every topic"""
    parameters: tuple[tuple[str, str], ...] = ()
    """(stage, its parameters as JSON)"""


def run(log: TrainingLog, files: FileTree, params: Params, ctx: Context) -> FileTree:
    """Write the recording of one training; ValueError when there is no curve."""
    from afford.recording.mcap_files import as_tree, write_recording
    from afford.recording.provenance import of_files, with_parameters
    from afford.recording.trainings import previews, record_training

    if not log.curves:
        raise ValueError(f"{log.name}: no curves to record; train for at least one logged step")
    path = ctx.scratch / f"{log.name}.mcap"
    recording = record_training(log, params.stage, previews(files))
    write_recording(path, with_parameters(of_files(recording, params.stage, files), params.parameters))
    return as_tree(log.name, path)
