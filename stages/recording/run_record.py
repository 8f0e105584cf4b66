"""Record the files of a run over all clips (a data set, a report): numbers, text and pictures.

Reads   FileTree of the stage
Writes  FileTree of one file, <stage>.mcap: JSON and Markdown as documents, paragraphs as a log, pictures unchanged
Method  one topic per file below /<stage>; log time is the fixed base of all recordings, with a millisecond between two lines
Fails   when there is neither text nor picture, or a text is not UTF-8
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.spec import Context

LIBRARIES = ("numpy", "opencv-python-headless", "mcap", "mcap-protobuf-support", "foxglove-schemas-protobuf", "protobuf",
             "zstandard", "blake3")  # fmt: skip
THREADS = 1
MEMORY_GIB = 0.5


@dataclass(frozen=True)
class Params:
    """Parameters of `run_record`."""

    stage: str
    """stage that wrote the files; its name is the first word of every topic"""


def run(files: FileTree, params: Params, ctx: Context) -> FileTree:
    """Write the recording of one run; ValueError when no file can be recorded."""
    from afford.recording.mcap_files import as_tree, write_recording
    from afford.recording.provenance import of_files
    from afford.recording.run_files import record_files

    path = ctx.scratch / f"{params.stage}.mcap"
    write_recording(path, of_files(record_files(files, params.stage), params.stage, files))
    return as_tree(params.stage, path)
