"""Constructive traces: map each key to its output, with provenance; one sealed file per key, replaced atomically.

    traces/ab/cdef.json     output of a key, with provenance, cost and reason
    failures/ab/cdef.json   error of a key; removed on success
    code/<digest>.json      definitions behind a code fingerprint, by which `explain` names a change
    .cache/index.json       all traces in one file, and the last key of every (stage, shard); rebuilt from traces/

A trace in the index is valid while its file keeps its size and change time. A file that was damaged since is rewritten from the
index. A damaged file without entry in the index is ignored, and its task runs again.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from runner.files import DamagedError, format_of, read_cache, seal, unseal, write_atomic, write_cache
from runner.lease import Lease


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


class Traces:
    """Traces of a store in memory, in step with traces/ on disk."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self._index = root / ".cache" / "index.json"
        self._rows: dict[str, dict[str, Any]] = {}
        self._stamps: dict[str, list[int]] = {}
        """key -> size and change time of the trace's file when it was read"""
        self._checked: set[str] = set()
        self._latest: dict[str, dict[str, tuple[str, float]]] = {}
        """stage -> shard -> (key used last, time of use)"""
        self._forgotten: set[str] = set()
        self._fresh = False
        self._load()

    def get(self, key: str) -> Trace | None:
        """Trace of a key, also when another process has just written it."""
        row = self._row(key)
        return Trace(**row) if row else None

    def output(self, key: str) -> str | None:
        """Artifact stored under a key."""
        row = self._row(key)
        return row["output"] if row else None

    def cost(self, key: str) -> tuple[float, float]:
        """(CPU seconds, wall seconds) of the task with this key."""
        row = self._row(key) or {"cpu_s": 0.0, "wall_s": 0.0}
        return row["cpu_s"], row["wall_s"]

    def peak(self, key: str) -> float:
        """Peak memory, MiB, of the process during the task with this key."""
        row = self._row(key) or {"peak_rss_mib": 0.0}
        return float(row["peak_rss_mib"])

    def reread(self, key: str) -> str | None:
        """Artifact stored under a key, from the disk alone."""
        self._drop(key)
        return self.output(key)

    def last(self, stage: str, shard: str) -> Trace | None:
        """Newest trace of a shard of a stage that a run used."""
        key, _ = self._latest.get(stage, {}).get(shard, ("", 0.0))
        return self.get(key) if key else None

    def shards(self, stage: str) -> dict[str, str]:
        """Map each shard of a stage to the key of its last use."""
        return {shard: key for shard, (key, _) in self._latest.get(stage, {}).items()}

    def use(self, stage: str, shard: str, key: str) -> None:
        """Record that a run has used this key for the shard.

        The modification time of the trace file stores the use as well, in case the index is lost.
        """
        shards = self._latest.setdefault(stage, {})
        if shard not in shards or shards[shard][0] != key:
            if shard in shards:
                self._touch(key)
            shards[shard] = key, time.time()
            self._fresh = True

    def _touch(self, key: str) -> None:
        path = trace_path(self.root, key)
        os.utime(path)
        if key in self._stamps:
            self._stamps[key] = _stamp(path)

    def renew(self) -> None:
        """Check every file again: another process may have changed it."""
        self._checked.clear()

    def all(self) -> Iterator[Trace]:
        """Yield every trace."""
        return (trace for trace in map(self.get, list(self._rows)) if trace is not None)

    def latest_keys(self) -> set[str]:
        """Keys of the last use of every shard."""
        return {key for shards in self._latest.values() for key, _ in shards.values()}

    def mend(self) -> list[str]:
        """Read every file of traces/ again, and return the keys of damaged ones.

        A damaged trace is rewritten from the index, or deleted if the index lacks it.
        """
        damaged = [key for key in sorted(_names(self.root / "traces")) if _read_row(self.root, key) is None]
        for key in damaged:
            if self._mended(self._rows.get(key)) is None:
                trace_path(self.root, key).unlink()
        return damaged

    def save(self) -> None:
        """Write the index; entries that another run has added in the meantime stay."""
        if not self._fresh:
            return
        while not (lease := Lease(self.root / "leases" / "index.lock")).held:
            time.sleep(0.01)
        try:
            self._write_index()
        finally:
            lease.release(remove=False)
        self._fresh = False

    def _write_index(self) -> None:
        saved = read_cache(self._index)
        self._merge(saved)
        rows, stamps = dict(saved.get("rows", {})), dict(saved.get("stamps", {}))
        rows |= self._rows
        stamps |= self._stamps
        for key in self._forgotten:
            rows.pop(key, None)
            stamps.pop(key, None)
        write_cache(self._index, {"rows": rows, "stamps": stamps, "latest": self._latest})

    def _merge(self, saved: dict[str, Any]) -> None:
        """Merge saved uses: of two uses of a shard the later one counts."""
        for stage, shards in saved.get("latest", {}).items():
            ours = self._latest.setdefault(stage, {})
            for shard, (key, when) in shards.items():
                if key not in self._forgotten and when > ours.get(shard, ("", 0.0))[1]:
                    ours[shard] = key, when

    def forget(self, key: str) -> None:
        """Delete a trace."""
        self._drop(key)
        self._forgotten.add(key)
        trace_path(self.root, key).unlink(missing_ok=True)
        for shards in self._latest.values():
            for shard in [shard for shard, (used, _) in shards.items() if used == key]:
                del shards[shard]
        self._fresh = True

    def _row(self, key: str) -> dict[str, Any] | None:
        """Trace as stored on disk; the copy in memory is used while the file is unchanged."""
        if key in self._checked:
            return self._rows[key]
        row = self._rows.get(key)
        try:
            found = _stamp(trace_path(self.root, key))
        except FileNotFoundError:
            self._drop(key)
            return None
        if row is None or self._stamps.get(key) != found:
            row = _read_row(self.root, key) or self._mended(row)
            if row is None:
                return None
            self._rows[key], self._stamps[key], self._fresh = row, _stamp(trace_path(self.root, key)), True
        self._checked.add(key)
        return row

    def _mended(self, row: dict[str, Any] | None) -> dict[str, Any] | None:
        """Rewrite a damaged file from the index; None when the index lacks it."""
        if row is not None:
            _write_row(self.root, row)
        return row

    def _drop(self, key: str) -> None:
        self._rows.pop(key, None)
        self._stamps.pop(key, None)
        self._checked.discard(key)

    def _load(self) -> None:
        """Load the index, drop traces that are gone from disk, and add those of runs that were killed before saving."""
        saved = read_cache(self._index)
        self._rows, self._stamps = saved.get("rows", {}), saved.get("stamps", {})
        self._merge(saved)
        there = set(_names(self.root / "traces"))
        for key in self._rows.keys() - there:
            self._drop(key)
        self._take(there - self._rows.keys())

    def _take(self, keys: Iterable[str]) -> None:
        """Add traces that the index lacks.

        Their time of use is when they were finished, or touched.
        """
        for row in [row for row in map(self._row, sorted(keys)) if row]:
            used, shards = _used(self.root, row), self._latest.setdefault(row["stage"], {})
            if used > shards.get(row["shard"], ("", 0.0))[1]:
                shards[row["shard"]] = row["key"], used


def write_trace(root: Path, trace: Trace) -> None:
    """Write a trace, which marks the task as finished, and remove its failure."""
    _write_row(root, asdict(trace))
    failure_path(root, trace.key).unlink(missing_ok=True)


def _write_row(root: Path, row: dict[str, Any]) -> None:
    write_atomic(trace_path(root, row["key"]), seal(row, f"trace {row['key']}"))


def store_format(root: Path) -> str | None:
    """Format of a store, read from its first undamaged trace; None when it has none."""
    formats = (format_of(trace_path(root, key).read_bytes(), f"trace {key}") for key in _names(root / "traces"))
    return next(filter(None, formats), None)


def _read_row(root: Path, key: str) -> dict[str, Any] | None:
    """Read a trace from disk; None when it is missing or damaged."""
    try:
        return dict(unseal(trace_path(root, key).read_bytes(), f"trace {key}"))
    except (FileNotFoundError, DamagedError):
        return None


def _stamp(path: Path) -> list[int]:
    found = os.stat(path)
    return [found.st_size, found.st_ctime_ns]


def _used(root: Path, row: dict[str, Any]) -> float:
    """Time of the last use of a trace, seconds since 1970.

    An impossible modification time does not count.
    """
    touched = os.stat(trace_path(root, row["key"])).st_mtime
    return float(touched if row["finished"] < touched <= time.time() else row["finished"])


def read_output(root: Path, key: str) -> str | None:
    """Artifact stored under a key, from the disk."""
    row = _read_row(root, key)
    return row["output"] if row else None


def write_failure(root: Path, key: str, stage: str, shard: str, message: str, details: str) -> None:
    """Record a failure for `status` and for people; the next run retries the task all the same."""
    row = {"key": key, "stage": stage, "shard": shard, "message": message, "traceback": details}
    write_atomic(failure_path(root, key), seal(row, f"failure {key}"))


def failures(root: Path) -> list[dict[str, str]]:
    """List failures without a later success; damaged records are skipped."""
    found = []
    for key in sorted(_names(root / "failures")):
        with suppress(DamagedError, FileNotFoundError):
            found.append(unseal(failure_path(root, key).read_bytes(), f"failure {key}"))
    return found


def trace_path(root: Path, key: str) -> Path:
    """Path of a trace: traces/ab/cdef.json."""
    return Path(f"{root}/traces/{key[:2]}/{key[2:]}.json")


def failure_path(root: Path, key: str) -> Path:
    """Path of a failure: failures/ab/cdef.json."""
    return Path(f"{root}/failures/{key[:2]}/{key[2:]}.json")


def _names(folder: Path) -> Iterator[str]:
    """Digests in a folder that is split by their first two letters."""
    for prefix in os.listdir(folder):
        for name in os.listdir(folder / prefix) if len(prefix) == 2 else ():
            if name.endswith(".json") and not name.startswith("."):
                yield prefix + name[:-5]
