"""Append-only segments of checksummed rows: the record of everything that a store holds.

    traces/<session>-<process>-<random id>.log      one writer each; a line is "<checksum> <JSON array>"

    ["spec", digest, {...}]             what all tasks of a stage share: function, parameters, code, libraries, threads, machine
    ["artifact", digest, kind, files, children]
                                        a file: name, blob, size, change time; outside the store also path, stamp
    ["trace", key, output, spec, stage, shard, inputs, schemas, seed, reason, cpu_s, wall_s, peak_mib, finished]
    ["use", stage, shard, key, time]    a run has used a key again, after an undo
    ["drop", stage, digest, time]       the bytes of an artifact were deleted on purpose
    ["failure", key, stage, shard, message, traceback, time]
    ["forget", key, time]               a trace was removed

A row is written by one call, so that a kill leaves at most one torn line, at the end. Torn and damaged lines are skipped. A later
row about the same digest or key replaces an earlier one. The writer holds a kernel lock on its segment as long as it lives.
"""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from blake3 import blake3

from runner.files import FORMAT, host
from runner.lease import has_writer

CHECK = 32
"""hexadecimal digits of a row's checksum"""
SUFFIX = ".log"
_ENCODE = json.JSONEncoder(separators=(",", ":")).encode
_TAG = f"{FORMAT} row\0".encode()


def encode(row: list[Any]) -> bytes:
    """Line of a row, with its checksum."""
    body = _ENCODE(row).encode()
    return blake3(_TAG + body).hexdigest(16).encode() + b" " + body + b"\n"


def decode(line: bytes) -> list[Any] | None:
    """Row of a line without its end; None for a damaged line."""
    body = line[CHECK + 1 :]
    if line[CHECK : CHECK + 1] != b" " or blake3(_TAG + body).hexdigest(16).encode() != line[:CHECK]:
        return None
    return list(json.loads(body))


def lines(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield (offset, line) for every complete line."""
    at = 0
    while (end := data.find(b"\n", at)) >= 0:
        yield at, data[at:end]
        at = end + 1


def body_of(kind: str, files: list[Any], children: list[Any] | None) -> str:
    """Encoded manifest: fields separated by tabs for plain files in the store, JSON otherwise."""
    if children is None and all(len(file) == 4 for file in files):
        text = "\t".join([kind, *(str(field) for file in files for field in file)])
        if text.count("\t") == 4 * len(files) and text[:1] != "[":
            return text
    return json.dumps([kind, files, children], separators=(",", ":"))


class SegmentWriter:
    """Segment of this process; the file is created with the first row."""

    def __init__(self, root: Path, session: str) -> None:
        self._folder, self._session = root / "traces", session
        self._file: int | None = None
        self._owner = 0
        self.name, self.size = "", 0

    def append(self, rows: bytes) -> int:
        """Write encoded rows; return their offset in the segment."""
        if self._file is None or self._owner != os.getpid():
            self._open()
        assert self._file is not None
        start, written = self.size, 0
        try:
            while written < len(rows):
                written += os.write(self._file, rows[written:])
        except OSError:  # a full disk: the torn line ends this segment
            self.close()
            raise
        self.size += len(rows)
        return start

    def close(self) -> None:
        """Close the segment; the next row begins a new one."""
        if self._file is not None and self._owner == os.getpid():
            os.close(self._file)
        self._file, self.name, self.size = None, "", 0

    def _open(self) -> None:
        name = f"{self._session}-{os.getpid()}-{os.urandom(4).hex()}{SUFFIX}"
        hidden = self._folder / f".{name}"
        file = os.open(hidden, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND, 0o644)
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        os.rename(hidden, self._folder / name)  # visible only when locked: a segment without lock has ended
        self._file, self._owner, self.name, self.size = file, os.getpid(), name, 0


def new_session() -> str:
    """Name of a run: host, process, random id."""
    return f"{host()}-{os.getpid()}-{os.urandom(4).hex()}"


def segment_names(root: Path) -> list[str]:
    """Names of all segments, sorted."""
    return sorted(name for name in os.listdir(root / "traces") if name.endswith(SUFFIX) and not name.startswith("."))


def read_from(root: Path, name: str, start: int) -> bytes:
    """Read the complete lines of a segment from an offset; b"" when it is gone."""
    try:
        with open(root / "traces" / name, "rb") as file:
            file.seek(start)
            data = file.read()
    except FileNotFoundError:
        return b""
    return data[: data.rfind(b"\n") + 1]


class OtherRuns:
    """Outputs that other runs have stored since a list of offsets was taken.

    A worker checks it under the lease of a key, so that concurrent runs execute each task once. Segments whose writer has ended
    are read once; those of the worker's own session are not read, since a scheduler starts each of its keys once.
    """

    def __init__(self, root: Path, session: str, offsets: Mapping[str, int]) -> None:
        self._root, self._offsets, self._own = root, dict(offsets), f"{session}-"
        self._closed: set[str] = set()
        self._outputs: dict[str, str] = {}
        self.bodies: dict[str, str] = {}
        """encoded manifests of the artifacts that other runs have stored"""

    def output(self, key: str) -> str | None:
        """Artifact that another run has stored under a key."""
        for name in os.listdir(self._root / "traces"):
            if name not in self._closed and name[0] != "." and not name.startswith(self._own):
                self._read(name)
        return self._outputs.get(key)

    def _read(self, name: str) -> None:
        ended = not has_writer(self._root / "traces" / name)  # before reading: rows written until then are read
        start = self._offsets.get(name, 0)
        data = read_from(self._root, name, start)
        self._offsets[name] = start + len(data)
        for _, line in lines(data):
            row = decode(line)
            if row is not None and row[0] == "trace":
                self._outputs[row[1]] = row[2]
            elif row is not None and row[0] == "artifact":
                self.bodies[row[1]] = body_of(row[2], row[3], row[4])
        if ended:
            self._closed.add(name)
