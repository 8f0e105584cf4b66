"""Record a part scorer: the curves of its training, then its scores of validation objects.

Reads   PartLessons of all objects, of which those of the split val are shown; TrainingLog and FileTree of scorer_train
Writes  FileTree of one file, <name>.mcap: a topic per curve with flat doubles, then a sheet of candidates for each of some objects
        with the predicted part and the true one; the parameters
Method  log time is the fixed base of all recordings plus a millisecond per step; a second between two sheets
Fails   when the training has no curve, or the files are not a scorer
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.spec import Context
from schemas.surface import PartLessons
from schemas.training import TrainingLog

LIBRARIES = ("numpy", "torch", "scipy", "safetensors", "pillow", "matplotlib", "opencv-python-headless", "mcap",
             "mcap-protobuf-support", "foxglove-schemas-protobuf", "protobuf", "zstandard", "blake3")  # fmt: skip
THREADS = 1
MEMORY_GIB = 1.0


@dataclass(frozen=True)
class Params:
    """Parameters of `scorer_record`."""

    stage: str = "scorer_train"
    """stage that trained; its name is the first word of every topic"""
    objects: int = 8
    """number of objects, spread over the validation split"""
    parameters: tuple[tuple[str, str], ...] = ()
    """(stage, its parameters as JSON)"""


def run(lessons: tuple[PartLessons, ...], log: TrainingLog, files: FileTree, params: Params, ctx: Context) -> FileTree:
    """Score the candidates of each object, and write the recording."""
    from afford.recording.mcap_files import as_tree, write_recording
    from afford.recording.part_scorer import record_scorer
    from afford.recording.provenance import of_files, with_parameters
    from afford.surface.score.part_scorer import load_scorer

    if not log.curves:
        raise ValueError(f"{log.name}: no curves to record; train for at least one logged step")
    judged = [one for one in lessons if one.split == "val"]
    path = ctx.scratch / f"{log.name}.mcap"
    recording = record_scorer(log, params.stage, load_scorer(files).eval(), judged, params.objects)
    write_recording(path, with_parameters(of_files(recording, params.stage, files), params.parameters))
    return as_tree(log.name, path)
