"""Constructive traces: key -> output, with everything that explains it. One file per key, renamed into place at once.

    traces/ab/cdef.json     what was made under a key: provenance, cost, reason
    failures/ab/cdef.json   why a key failed; gone as soon as it succeeds
    code/<digest>.json      the definitions behind a code fingerprint, so that a change can be named
    .cache/index.json       all traces in one file and the last key of every (stage, shard); rebuilt from traces/ when gone
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from runner.files import read_cache, write_atomic
from runner.lease import Lease


@dataclass(frozen=True)
class Trace:
    """How an artifact came to be. Times are for people and for cost tables; nothing here is part of any content."""

    key: str
    stage: str
    shard: str
    function: str
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
    """All traces of a store in memory, kept in step with traces/ on disk."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self._index = root / ".cache" / "index.json"
        self._rows: dict[str, dict[str, Any]] = {}
        self._latest: dict[str, dict[str, str]] = {}
        self._forgotten: set[str] = set()
        self._used: dict[tuple[str, str], str] = {}
        self._fresh = False
        self._load()

    def get(self, key: str) -> Trace | None:
        """The trace of a key, also when another process has just written it."""
        row = self._rows.get(key) or self._read(key)
        return Trace(**row) if row else None

    def output(self, key: str) -> str | None:
        """The artifact made under a key."""
        row = self._rows.get(key) or self._read(key)
        return row["output"] if row else None

    def cost(self, key: str) -> tuple[float, float]:
        """(CPU seconds, wall seconds) of what was made under a key."""
        row = self._rows.get(key) or self._read(key) or {"cpu_s": 0.0, "wall_s": 0.0}
        return row["cpu_s"], row["wall_s"]

    def peak(self, key: str) -> float:
        """Peak memory, MiB, of the process that made what is under a key, while it made it."""
        row = self._rows.get(key) or self._read(key) or {"peak_rss_mib": 0.0}
        return float(row["peak_rss_mib"])

    def reread(self, key: str) -> str | None:
        """The artifact made under a key, according to the disk alone."""
        self._rows.pop(key, None)
        return self.output(key)

    def last(self, stage: str, shard: str) -> Trace | None:
        """The newest trace of a shard of a stage that a run used."""
        key = self._latest.get(stage, {}).get(shard)
        return self.get(key) if key else None

    def shards(self, stage: str) -> dict[str, str]:
        """shard -> key of the last use of every shard of a stage."""
        return dict(self._latest.get(stage, {}))

    def use(self, stage: str, shard: str, key: str) -> None:
        """A run has used this key for the shard."""
        if self._latest.setdefault(stage, {}).get(shard) != key:
            self._latest[stage][shard] = self._used[stage, shard] = key
            self._fresh = True

    def all(self) -> Iterator[Trace]:
        """Every trace."""
        return (Trace(**row) for row in list(self._rows.values()))

    def latest_keys(self) -> set[str]:
        """The keys in use."""
        return {key for shards in self._latest.values() for key in shards.values()}

    def save(self) -> None:
        """Write the index, at once; what another run has written to it in the meantime stays."""
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
        saved = read_cache(self._index) or {"rows": {}, "latest": {}}
        for stage, shards in saved["latest"].items():
            for shard, key in shards.items():
                if (stage, shard) not in self._used and key not in self._forgotten:
                    self._latest.setdefault(stage, {})[shard] = key
        write_atomic(self._index, json.dumps({"rows": self._rows, "latest": self._latest}).encode())

    def forget(self, key: str) -> None:
        """Delete a trace."""
        self._rows.pop(key, None)
        self._forgotten.add(key)
        trace_path(self.root, key).unlink(missing_ok=True)
        for shards in self._latest.values():
            for shard in [shard for shard, used in shards.items() if used == key]:
                del shards[shard]
        self._fresh = True

    def _read(self, key: str) -> dict[str, Any] | None:
        try:
            row = json.loads(trace_path(self.root, key).read_bytes())
            Trace(**row)
        except (FileNotFoundError, ValueError, TypeError):
            return None
        self._rows[key] = row
        self._fresh = True
        return row

    def _load(self) -> None:
        """The index, less what is gone from disk, plus what is new there (the runs that were killed before they wrote it)."""
        saved = read_cache(self._index)
        if saved:
            self._rows, self._latest = saved["rows"], saved["latest"]
        there = set(_names(self.root / "traces"))
        for key in self._rows.keys() - there:
            del self._rows[key]
        new = [row for row in map(self._read, sorted(there - self._rows.keys())) if row]
        for row in sorted(new, key=lambda row: row["finished"]):
            self.use(row["stage"], row["shard"], row["key"])


def write_trace(root: Path, trace: Trace) -> None:
    """The moment a task is finished."""
    write_atomic(trace_path(root, trace.key), json.dumps(asdict(trace)).encode())
    failure_path(root, trace.key).unlink(missing_ok=True)


def read_output(root: Path, key: str) -> str | None:
    """The artifact made under a key, from the disk."""
    try:
        return json.loads(trace_path(root, key).read_bytes())["output"]
    except (FileNotFoundError, ValueError, KeyError):
        return None


def write_failure(root: Path, key: str, stage: str, shard: str, message: str, details: str) -> None:
    """Beside the key, for `status` and for people; the next run tries again all the same."""
    row = {"key": key, "stage": stage, "shard": shard, "message": message, "traceback": details}
    write_atomic(failure_path(root, key), json.dumps(row).encode())


def failures(root: Path) -> list[dict[str, str]]:
    """Everything that failed and has not succeeded since."""
    return [json.loads(failure_path(root, key).read_bytes()) for key in sorted(_names(root / "failures"))]


def trace_path(root: Path, key: str) -> Path:
    """traces/ab/cdef.json"""
    return Path(f"{root}/traces/{key[:2]}/{key[2:]}.json")


def failure_path(root: Path, key: str) -> Path:
    """failures/ab/cdef.json"""
    return Path(f"{root}/failures/{key[:2]}/{key[2:]}.json")


def _names(folder: Path) -> Iterator[str]:
    """The digests that a sharded folder holds."""
    for prefix in os.listdir(folder):
        for name in os.listdir(folder / prefix):
            if name.endswith(".json") and not name.startswith("."):
                yield prefix + name[:-5]
