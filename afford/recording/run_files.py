"""Recorder of a run's files (a data set, a report): JSON, Markdown and pictures below /<stage>."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import PurePosixPath

from foxglove_schemas_protobuf.Log_pb2 import Log

from afford.recording.mcap_files import EPOCH_NS, Channel, Message, Recording
from afford.recording.messages import PAPER, Document, channel, image, image_channel, log, stamped
from schemas.files import FileRef, FileTree

PICTURES = {".png": "png", ".jpg": "jpeg", ".jpeg": "jpeg"}
TEXTS = {".json": "application/json", ".md": "text/markdown"}
STEP_NS = 1_000_000
"""files have no media time: log lines are a millisecond apart"""


def record_files(value: FileTree, stage: str) -> Recording:
    """Record one topic per picture and per JSON or Markdown file, and the Markdown's paragraphs as a log.

    Other files are left out. ValueError when no file can be recorded.
    """
    texts = [file for file in value.files if _suffix(file) in TEXTS]
    pictures = [file for file in value.files if _suffix(file) in PICTURES]
    channels: list[Channel] = [channel(_topic(stage, file), Document) for file in texts]
    channels += [image_channel(_topic(stage, file)) for file in pictures]
    if not channels:
        raise ValueError(f"{value.name}: none of {len(value.files)} files is JSON, Markdown or a picture to record")
    messages = [_text(stage, file) for file in texts] + [_picture(stage, file) for file in pictures]
    return Recording((*channels, channel(f"/{stage}/log", Log)), [*messages, *_log(stage, texts)])


def _text(stage: str, file: FileRef) -> Message:
    text = file.path.read_text(encoding="utf-8")
    return stamped(_topic(stage, file), EPOCH_NS, Document(name=file.name, media_type=TEXTS[_suffix(file)], text=text))


def _picture(stage: str, file: FileRef) -> Message:
    return image(_topic(stage, file), EPOCH_NS, file.path.read_bytes(), PICTURES[_suffix(file)], PAPER)


def _log(stage: str, texts: list[FileRef]) -> Iterator[Message]:
    """Paragraphs and tables of the Markdown files, for viewers without documents; the first has the time of the files."""
    parts = [(file.name, part) for file in texts if _suffix(file) == ".md"
             for part in re.split(r"\n\s*\n", file.path.read_text(encoding="utf-8")) if part.strip()]  # fmt: skip
    for n, (name, part) in enumerate(parts):
        yield log(f"/{stage}/log", EPOCH_NS + n * STEP_NS, part.strip(), name)


def _topic(stage: str, file: FileRef) -> str:
    """/<stage>/<file name without suffix>, in characters that topics allow."""
    return f"/{stage}/" + re.sub(r"[^\w/]+", "_", str(PurePosixPath(file.name).with_suffix(""))).lower()


def _suffix(file: FileRef) -> str:
    return PurePosixPath(file.name).suffix.lower()
