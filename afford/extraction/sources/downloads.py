"""Which of the published files lie in a source folder, whole or in part, told from their ends alone."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Literal

from afford.common.folders import Entry, entries
from afford.extraction.sources.discover import NO_PICTURES
from afford.extraction.sources.published import Published

State = Literal["there", "partial", "missing"]
UNFINISHED = (".aria2", ".part", ".partial", ".crdownload")
"""what downloaders keep beside, or instead of, a file that is not complete"""


def states(root: Path, wanted: Iterable[Published]) -> Iterator[tuple[Published, State]]:
    """Each file with its state; it may lie anywhere below `root`, frames also unpacked. No file is read but for its ends."""
    found: dict[str, list[Entry]] = {}
    for entry in entries(root) if root.is_dir() else ():
        if not entry.odd and not set(NO_PICTURES) & set(entry.name.split("/")[:-1]):
            found.setdefault(entry.name.rpartition("/")[2].lower(), []).append(entry)
            found.setdefault(entry.folder.lower(), [])
    for file in wanted:
        base = file.name.rpartition("/")[2].lower()
        unpacked = file.kind in ("frames", "key-frames") and file.video.lower() in found
        yield file, "there" if unpacked else _state(found.get(base, []))


def _state(places: list[Entry]) -> State:
    if not places:
        return "missing"
    return "there" if any(_whole(entry.path) for entry in places) else "partial"


def _whole(path: Path) -> bool:
    """Whether the end of a file is that of a whole one of its kind."""
    size = os.stat(path).st_size
    if size == 0 or any(path.with_name(path.name + suffix).exists() for suffix in UNFINISHED):
        return False
    suffix = path.suffix.lower()
    if suffix == ".zip":
        return zipfile.is_zipfile(path)
    if suffix == ".mp4":
        return _boxes_end(path) == size
    tail = _tail(path, size)
    if suffix == ".tar":
        return size % 512 == 0 and not any(tail)
    return tail.rstrip()[-1:] in (b"}", b"]") if suffix == ".json" else True


def _tail(path: Path, size: int) -> bytes:
    with path.open("rb") as stream:
        stream.seek(max(size - 1024, 0))
        return stream.read()


def _boxes_end(path: Path) -> int:
    """Where the outermost boxes of an MP4 file say that it ends (ISO 14496-12)."""
    at, size = 0, os.stat(path).st_size
    with path.open("rb") as stream:
        while at < size:
            stream.seek(at)
            head = stream.read(16)
            length = int.from_bytes(head[:4], "big")
            if length == 1:
                length = int.from_bytes(head[8:16], "big")
            if length == 0:
                return size  # to the end of the file, whatever that is
            if length < 8:
                return -1
            at += length
    return at
