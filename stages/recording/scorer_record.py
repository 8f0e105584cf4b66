"""the curves of the part scorer's training, and what it says of objects that judge -> its recording.

Reads   PartLessons of all objects, of which those of the split val are shown; TrainingLog and FileTree of scorer_train
Writes  FileTree of one file, <name>.mcap: a topic per curve with flat doubles, then a sheet of candidates for each of some objects
        with the part that was named and the true one; the parameters
Method  log time is the fixed base of all recordings, a millisecond per step; a second between two sheets
Fails   when the training measured nothing, for files that are no scorer
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
    stage: str = "scorer_train"
    """the stage that trained; its name is the first word of every topic"""
    objects: int = 8
    """objects that are shown, spread over those that judge"""
    parameters: tuple[tuple[str, str], ...] = ()
    """(stage, its parameters as JSON)"""


def run(lessons: tuple[PartLessons, ...], log: TrainingLog, files: FileTree, params: Params, ctx: Context) -> FileTree:
    """Ask the scorer about each object, and write the recording."""
    from afford.recording.mcap_files import as_tree, write_recording
    from afford.recording.part_scorer import record_scorer
    from afford.recording.provenance import of_files, with_parameters
    from afford.surface.score.part_scorer import load_scorer

    if not log.curves:
        raise ValueError(f"{log.name}: expected curves to record, got none")
    judged = [one for one in lessons if one.split == "val"]
    path = ctx.scratch / f"{log.name}.mcap"
    recording = record_scorer(log, params.stage, load_scorer(files).eval(), judged, params.objects)
    write_recording(path, with_parameters(of_files(recording, params.stage, files), params.parameters))
    return as_tree(log.name, path)
