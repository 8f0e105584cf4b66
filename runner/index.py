"""Index of a store in memory: key -> output, and artifact -> files or children; rebuilt from the segments at will.

    .cache/index        the index as of some offset of each segment, sealed

Loading reads the saved index and then the rows that segments have gained since. The saved index is discarded when a segment is
missing, shorter than before, or changed without growth. It is written again once many rows have been added, so that a run with
few new rows writes nothing else.

Numbers and names are kept in columns, and everything else of a trace stays in its segment, so that 100,000 tasks need little
memory.
"""

from __future__ import annotations

import gc
import json
import os
import time
from array import array
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from runner.files import Stamp, read_cache, write_cache
from runner.segments import SegmentWriter, body_of, decode, encode, lines, new_session, read_from, segment_names

NEW_ROWS, NEW_SHARE = 2000, 0.25
"""the index is saved when more rows than both this number and this share of all have been added"""
NUMBERS = 5
"""numbers of a trace: CPU seconds, wall seconds, peak MiB, time of finishing, time of last use"""
CHUNK_BYTES = 1 << 16


@dataclass(frozen=True)
class Trace:
    """Provenance of an artifact.

    Times serve people and cost tables; no field is part of any content.
    """

    key: str
    stage: str
    shard: str
    function: str
    """'module:function' at the time of the run"""
    output: str
    inputs: dict[str, str]
    params: Any
    code: str
    schemas: dict[str, str]
    libraries: dict[str, str]
    threads: int
    seed: int
    machine: str
    reason: str
    cpu_s: float
    wall_s: float
    peak_rss_mib: float
    finished: float
    """seconds since 1970"""


class Entry(NamedTuple):
    """One file of an artifact.

    `changed` is the change time of its blob when it was hashed, in ns. A leaf's file outside the store has a path, and its stamp
    at the time of hashing.
    """

    name: str
    blob: str
    size: int
    changed: int = 0
    path: str = ""
    stamp: Stamp | None = None


class Manifest(NamedTuple):
    """Files of a plain artifact, or children of a composite one."""

    kind: str
    files: tuple[Entry, ...] = ()
    children: tuple[tuple[str, str], ...] | None = None


class Index:
    """All traces, artifacts, uses, drops and failures of a store."""

    def __init__(self, root: Path, session: str | None = None) -> None:
        self.root, self.session = root, session or new_session()
        self.writer = SegmentWriter(root, self.session)
        self._cache = root / ".cache" / "index.json"
        self._clear()
        self.load()

    def _clear(self) -> None:
        self._rows: dict[str, int] = {}
        """key -> number of its row in the columns"""
        self._outputs: list[str] = []
        self._stages: list[str] = []
        self._shards: list[str] = []
        self._specs: list[str] = []
        self._reasons: list[str] = []
        self._texts: dict[str, str] = {}
        """equal texts are kept once"""
        self._numbers = array("d")
        self._segments: list[str] = []
        self._where = array("q")
        """segment number and offset of each row, interleaved"""
        self._number_of: dict[str, int] = {}
        self._latest: dict[str, dict[str, int]] = {}
        """stage -> shard -> row of its last use"""
        self._again: list[tuple[str, str, str, float]] = []
        """(stage, shard, key, time) of uses after an undo, or under another stage name"""
        self._bodies: dict[str, str] = {}
        """artifact -> its kind and files, or children"""
        self._spec_trees: dict[str, dict[str, Any]] = {}
        self.drops: dict[str, str] = {}
        """artifact whose bytes were deleted on purpose, or were found to be gone -> its stage; they may be back by now"""
        self._failures: dict[str, list[Any]] = {}
        self._forgotten: dict[str, float] = {}
        """key -> time at which its trace was removed"""
        self._offsets: dict[str, int] = {}
        self._changed: dict[str, int] = {}
        """segment -> change time when all of it had been read"""
        self.damaged: dict[str, int] = {}
        """segment -> damaged and torn lines"""
        self._added = 0

    # -- load and save ---------------------------------------------------------------------------------------------

    def load(self, cached: bool = True) -> None:
        """Read the saved index and the rows added since; all rows if the saved index does not fit, or with cached=False."""
        with no_collection():
            self._clear()
            saved = read_cache(self._cache) if cached else {}
            if saved and self._fits(saved):
                self._restore(saved)
            self.refresh()

    def _fits(self, saved: dict[str, Any]) -> bool:
        """Return True while every segment of the saved index is there, and unchanged or longer."""
        for name, offset, changed in zip(saved["segments"], saved["offsets"], saved["changed"], strict=True):
            try:
                found = os.stat(self.root / "traces" / name)
            except FileNotFoundError:
                return False
            if found.st_size < offset or (found.st_size == offset and found.st_ctime_ns != changed):
                return False
        return True

    def _restore(self, saved: dict[str, Any]) -> None:
        names = saved["stage_names"]
        self._outputs, self._shards = saved["outputs"], saved["shards"]
        self._stages = [names[number] for number in saved["stages"]]
        self._specs = [saved["spec_names"][number] for number in saved["specs"]]
        self._reasons = [saved["reason_names"][number] for number in saved["reasons"]]
        self._texts = {text: text for text in (*names, *saved["spec_names"], *saved["reason_names"])}
        self._rows = dict(zip(saved["keys"], range(len(self._outputs)), strict=True))
        self._numbers.frombytes(bytes.fromhex(saved["numbers"]))
        self._where.frombytes(bytes.fromhex(saved["where"]))
        self._segments = saved["segments"]
        self._number_of = {name: number for number, name in enumerate(self._segments)}
        self._offsets = dict(zip(self._segments, saved["offsets"], strict=True))
        self._changed = dict(zip(self._segments, saved["changed"], strict=True))
        self._bodies = dict(zip(saved["artifacts"], saved["bodies"], strict=True))
        self._spec_trees, self.drops, self._failures = saved["spec_trees"], saved["drops"], saved["failures"]
        self._again, self.damaged = [(*use,) for use in saved["again"]], saved["damaged"]
        self._forgotten = saved["forgotten"]
        self._find_latest()

    def _find_latest(self) -> None:
        used, self._latest = self._numbers[4::NUMBERS], {}
        for row, (stage, shard) in enumerate(zip(self._stages, self._shards, strict=True)):
            shards = self._latest.setdefault(stage, {})
            if used[row] >= 0 and (shard not in shards or used[row] > used[shards[shard]]):
                shards[shard] = row
        for stage, shard, key, when in self._again:
            self._note_use(stage, shard, key, when)

    def refresh(self) -> None:
        """Read the rows that segments have gained: those of other runs, and of runs that were killed."""
        uses, grown = len(self._again), 0
        for name in segment_names(self.root):
            found = os.stat(self.root / "traces" / name)
            start = self._offsets.get(name, 0)
            if found.st_size > start:
                self._read(name, start, found.st_size)
                grown += 1
            self._number(name)
            if found.st_size == self._offsets.setdefault(name, 0):
                self._changed[name] = found.st_ctime_ns
        if grown > 1 and len(self._again) > uses:
            self._find_latest()  # a use may have been read before the trace that it names

    def _read(self, name: str, start: int, size: int) -> None:
        data = read_from(self.root, name, start)
        self.ingest(data, name, start)
        torn = start + len(data) < size
        if torn and name != self.writer.name:
            self.damaged.setdefault(name, 1)

    def outdated(self) -> bool:
        """Return True when a segment that the index has read is gone: its rows were rewritten."""
        return not self._offsets.keys() <= set(segment_names(self.root))

    def ingest(self, rows: bytes, segment: str, start: int) -> None:
        """Take rows that a writer has appended to its segment at an offset; the offset advances if nothing is between."""
        number = self._number(segment)
        for at, line in lines(rows):
            row = decode(line)
            if row is None:
                self.damaged[segment] = self.damaged.get(segment, 0) + 1
            else:
                self._take(row, number, start + at)
        if self._offsets.setdefault(segment, 0) == start:
            self._offsets[segment] = start + len(rows)

    def _number(self, segment: str) -> int:
        if segment not in self._number_of:
            self._number_of[segment] = len(self._segments)
            self._segments.append(segment)
        return self._number_of[segment]

    def _take(self, row: list[Any], segment: int, offset: int) -> None:
        self._added += 1
        kind = row[0]
        if kind == "artifact":
            self._bodies[row[1]] = body_of(row[2], row[3], row[4])
        elif kind == "trace":
            self._take_trace(row, segment, offset)
        elif kind == "spec":
            self._spec_trees[row[1]] = row[2]
        elif kind == "use":
            self._again.append((row[1], row[2], row[3], row[4]))
            self._note_use(row[1], row[2], row[3], row[4])
        elif kind == "drop":
            self.drops[row[2]] = row[1]
        elif kind == "failure" and self._finished(row[1]) < row[6]:
            self._failures[row[1]] = row[1:]
        elif kind == "forget":
            self._forget(row[1], row[2])

    def _finished(self, key: str) -> float:
        """Time of finishing of a task, 0 without a trace."""
        row = self._rows.get(key)
        return 0.0 if row is None else self._numbers[NUMBERS * row + 3]

    def _forget(self, key: str, when: float) -> None:
        self._forgotten[key] = max(when, self._forgotten.get(key, 0.0))
        if key not in self._rows or self._finished(key) > when:
            return
        row = self._rows.pop(key)
        for shards in self._latest.values():
            for shard in [shard for shard, used in shards.items() if used == row]:
                del shards[shard]

    def _take_trace(self, row: list[Any], segment: int, offset: int) -> None:
        _, key, output, spec, stage, shard, _, _, _, reason, cpu_s, wall_s, peak_mib, finished = row
        known = self._rows.get(key)
        if self._finished(key) > finished or self._forgotten.get(key, 0.0) >= finished:
            return
        self._rows[key] = len(self._outputs)
        self._outputs.append(output)
        self._stages.append(self._texts.setdefault(stage, stage))
        self._shards.append(shard)
        self._specs.append(self._texts.setdefault(spec, spec))
        self._reasons.append(self._texts.setdefault(reason, reason))
        self._numbers.extend((cpu_s, wall_s, peak_mib, finished, finished))
        self._where.extend((segment, offset))
        if known is not None:
            self._numbers[NUMBERS * known + 4] = -1.0  # replaced: counts no more as a use
        self._failures.pop(key, None)
        self._note_use(stage, shard, key, finished)

    def _note_use(self, stage: str, shard: str, key: str, when: float) -> None:
        row, shards = self._rows.get(key), self._latest.setdefault(stage, {})
        if row is None:
            return
        last = shards.get(shard)
        if last is None or when >= self._numbers[NUMBERS * last + 4]:
            shards[shard] = row
            self._numbers[NUMBERS * row + 4] = max(when, self._numbers[NUMBERS * row + 4])

    def save(self) -> None:
        """Write the index if many rows have been added since."""
        if self._added > max(NEW_ROWS, NEW_SHARE * (len(self._outputs) + len(self._bodies))):
            self.write()

    def write(self) -> None:
        """Write the index."""
        self.refresh()
        self._compact()
        tables: dict[str, Any] = {}
        for name in ("stage", "spec", "reason"):
            column = getattr(self, f"_{name}s")
            numbers = {text: number for number, text in enumerate(dict.fromkeys(column))}
            tables |= {f"{name}_names": list(numbers), f"{name}s": [numbers[text] for text in column]}
        write_cache(self._cache, {
            "keys": list(self._rows), "outputs": self._outputs, "shards": self._shards, **tables,
            "numbers": self._numbers.tobytes().hex(), "where": self._where.tobytes().hex(), "segments": self._segments,
            "offsets": [self._offsets[name] for name in self._segments],
            "changed": [self._changed.get(name, 0) for name in self._segments],
            "artifacts": list(self._bodies), "bodies": list(self._bodies.values()), "spec_trees": self._spec_trees,
            "drops": self.drops, "failures": self._failures, "again": self._again, "damaged": self.damaged,
            "forgotten": self._forgotten})
        self._added = 0

    def _compact(self) -> None:
        """Remove replaced rows from the columns, so that row n is the n-th key."""
        order = list(self._rows.values())
        if order == list(range(len(self._outputs))):
            return
        numbers, where = self._numbers, self._where
        for name in ("_outputs", "_stages", "_shards", "_specs", "_reasons"):
            column = getattr(self, name)
            setattr(self, name, [column[row] for row in order])
        self._numbers = array("d", (number for row in order for number in numbers[NUMBERS * row : NUMBERS * (row + 1)]))
        self._where = array("q", (number for row in order for number in where[2 * row : 2 * row + 2]))
        self._rows = dict(zip(self._rows, range(len(order)), strict=True))
        self._find_latest()

    def offsets(self) -> dict[str, int]:
        """Number of bytes of each segment that the index has read."""
        return dict(self._offsets)

    # -- append ----------------------------------------------------------------------------------------------------

    def append(self, *rows: list[Any]) -> None:
        """Write rows to the segment of this process, and take them."""
        data = b"".join(map(encode, rows))
        start = self.writer.append(data)
        self.ingest(data, self.writer.name, start)

    def use(self, stage: str, shard: str, key: str) -> None:
        """Record that a run has used this key for the shard; a row is written only if it was not the last one."""
        last = self._latest.get(stage, {}).get(shard)
        if last is None or last != self._rows.get(key):
            self.append(["use", stage, shard, key, time.time()])

    def add_artifact(self, digest: str, manifest: Manifest) -> None:
        """Record an artifact."""
        self.append(artifact_row(digest, manifest))

    def forget(self, key: str) -> None:
        """Remove a trace; its task runs again."""
        self.append(["forget", key, time.time()])

    def drop(self, stage: str, digests: Iterable[str]) -> None:
        """Record that the bytes of artifacts are gone."""
        rows = [["drop", stage, digest, time.time()] for digest in digests if digest not in self.drops]
        if rows:
            self.append(*rows)

    # -- traces ----------------------------------------------------------------------------------------------------

    def __len__(self) -> int:
        return len(self._rows)

    def __contains__(self, key: str) -> bool:
        return key in self._rows

    def output(self, key: str) -> str | None:
        """Artifact stored under a key."""
        row = self._rows.get(key)
        return None if row is None else self._outputs[row]

    def costs(self, keys: Iterable[str]) -> tuple[list[float], list[float]]:
        """CPU seconds, and peak MiB, of the tasks with these keys; all have traces."""
        rows, numbers = [NUMBERS * self._rows[key] for key in keys], self._numbers
        return [numbers[row] for row in rows], [numbers[row + 2] for row in rows]

    def cost(self, key: str) -> tuple[float, float, float]:
        """(CPU seconds, wall seconds, peak MiB) of the task with this key; zeros without a trace."""
        row = self._rows.get(key)
        return (0.0, 0.0, 0.0) if row is None else tuple(self._numbers[NUMBERS * row : NUMBERS * row + 3])  # type: ignore[return-value]

    def get(self, key: str) -> Trace | None:
        """Trace of a key; None without one, or when its row was damaged since."""
        row = self._rows.get(key)
        if row is None:
            return None
        segment, offset = self._where[2 * row : 2 * row + 2]
        found = decode(_line(self.root / "traces" / self._segments[segment], offset))
        return self._trace(found) if found and found[0] == "trace" and found[1] == key else None

    def _trace(self, row: list[Any]) -> Trace | None:
        _, key, output, spec, stage, shard, inputs, schemas, seed, reason, cpu_s, wall_s, peak_mib, finished = row
        tree = self._spec_trees.get(spec)
        return None if tree is None else Trace(
            key=key, stage=stage, shard=shard, output=output, inputs=inputs, schemas=schemas, seed=seed, reason=reason, cpu_s=cpu_s,
            wall_s=wall_s, peak_rss_mib=peak_mib, finished=finished, **tree)

    def all(self) -> Iterator[Trace]:
        """Yield every trace."""
        for number, name in enumerate(self._segments):
            for at, line in lines(read_from(self.root, name, 0)):
                row = decode(line) if b'"trace"' in line[:50] else None
                if row and row[0] == "trace" and self._is_at(row[1], number, at) and (trace := self._trace(row)):
                    yield trace

    def _is_at(self, key: str, segment: int, offset: int) -> bool:
        row = self._rows.get(key)
        return row is not None and self._where[2 * row] == segment and self._where[2 * row + 1] == offset

    def last(self, stage: str, shard: str) -> Trace | None:
        """Trace that a run used last for a shard of a stage."""
        row = self._latest.get(stage, {}).get(shard)
        return None if row is None else self._at(row)

    def _at(self, row: int) -> Trace | None:
        segment, offset = self._where[2 * row : 2 * row + 2]
        found = decode(_line(self.root / "traces" / self._segments[segment], offset))
        return self._trace(found) if found and found[0] == "trace" else None

    def reason(self, key: str) -> str:
        """Reason of the run that stored a key."""
        return self._reasons[self._rows[key]]

    def keys(self) -> list[str]:
        """All keys with a trace."""
        return list(self._rows)

    def results(self) -> Iterator[tuple[str, str]]:
        """Yield (stage, output) of every trace, those that were read first first."""
        return ((self._stages[row], self._outputs[row]) for row in self._rows.values())

    def shards(self, stage: str) -> dict[str, str]:
        """Map each shard of a stage to the key of its last use."""
        keys = list(self._rows)
        if len(keys) != len(self._outputs):
            by_row = {row: key for key, row in self._rows.items()}
            return {shard: by_row[row] for shard, row in self._latest.get(stage, {}).items()}
        return {shard: keys[row] for shard, row in self._latest.get(stage, {}).items()}

    def stages(self) -> list[str]:
        """Names of all stages with a trace."""
        return list(self._latest)

    def latest_keys(self) -> set[str]:
        """Keys of the last use of every shard."""
        rows = {row for shards in self._latest.values() for row in shards.values()}
        return {key for key, row in self._rows.items() if row in rows}

    def uses(self) -> dict[tuple[str, str], dict[str, float]]:
        """Map each (stage, shard) to the keys that runs used for it, with the time of their last use."""
        found: dict[tuple[str, str], dict[str, float]] = {}
        for key, row in self._rows.items():
            found.setdefault((self._stages[row], self._shards[row]), {})[key] = self._numbers[NUMBERS * row + 3]
        for stage, shard, key, when in self._again:
            if key in self._rows:
                keys = found.setdefault((stage, shard), {})
                keys[key] = max(when, keys.get(key, 0.0))
        return found

    # -- artifacts -------------------------------------------------------------------------------------------------

    def body(self, digest: str) -> str | None:
        """Encoded manifest of an artifact, see `manifest_of`."""
        return self._bodies.get(digest)

    def has_spec(self, digest: str) -> bool:
        """Return True when what the tasks of a stage share is known under a digest."""
        return digest in self._spec_trees

    def has_artifact(self, digest: str) -> bool:
        """Return True when the manifest of an artifact is known."""
        return digest in self._bodies

    def bodies(self) -> Mapping[str, str]:
        """Encoded manifests of all artifacts."""
        return self._bodies

    def failures(self) -> list[dict[str, str]]:
        """Failures without a later success."""
        fields = ("key", "stage", "shard", "message", "traceback")
        return [dict(zip(fields, row, strict=False)) for _, row in sorted(self._failures.items())]


@contextmanager
def no_collection() -> Iterator[None]:
    """Pause Python's search for reference cycles, which takes long while very many objects are created."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


def artifact_row(digest: str, manifest: Manifest) -> list[Any]:
    """Row that records an artifact."""
    files = [[*entry[:5], entry.stamp] if entry.path else [*entry[:4]] for entry in manifest.files]
    return ["artifact", digest, manifest.kind, files, manifest.children]


def manifest_of(body: str) -> Manifest:
    """Decode a manifest."""
    if body[:1] != "[":
        kind, *fields = body.split("\t")
        groups = zip(fields[::4], fields[1::4], fields[2::4], fields[3::4], strict=True)
        return Manifest(kind, tuple(Entry(name, blob, int(size), int(changed)) for name, blob, size, changed in groups))
    kind, files, children = json.loads(body)
    entries = tuple(map(_entry, files))
    return Manifest(kind, entries, None if children is None else tuple((name, digest) for name, digest in children))


def _entry(file: list[Any]) -> Entry:
    if len(file) == 4:
        return Entry(*file)
    name, blob, size, changed, path, (length, modified, inode, status) = file
    return Entry(name, blob, size, changed, path, (length, modified, inode, status))


def _line(path: Path, offset: int) -> bytes:
    """Line of a file at an offset, without its end; b"" when the file is gone."""
    data = b""
    try:
        with open(path, "rb") as file:
            file.seek(offset)
            while b"\n" not in data and (chunk := file.read(CHUNK_BYTES)):
                data += chunk
    except FileNotFoundError:
        return b""
    return data.partition(b"\n")[0]
