"""Garbage collection: delete what the last uses of the shards do not reach, and bytes that can be computed again.

Kept are the results of the last keys of every shard: their traces, outputs and inputs. The bytes of stages that are dropped are
deleted although their traces stay: their tasks still count as cached, and run again only when something needs the bytes.
"""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from runner.index import Index, Manifest, Trace
from runner.past_runs import expired
from runner.segments import decode, lines, read_from, segment_names
from runner.store import Store
from runner.upkeep import DAY_S, rewrite

ELSEWHERE = "(no stage)"
"""owner of bytes that belong to no trace, like those of a run that was killed"""
HISTORY, SCRATCH, DAMAGED, CODE = "(history)", "(scratch)", "(damaged)", "(code)"


class UnknownStageError(ValueError):
    """No task of this stage is in the store; the message lists the stages that are."""


@dataclass(frozen=True)
class Rules:
    """Rules of gc: the results that it keeps."""

    keep_last: int = 1
    """keys of every shard, by their last use; at least 1"""
    older_than_days: float = 0.0
    """results that were used since are kept as well"""
    drop: tuple[str, ...] = ()
    """stages whose bytes are deleted, unless something else has the same bytes"""


@dataclass
class GcResult:
    """Number and size of files that gc deleted, or would delete."""

    files: int = 0
    bytes: int = 0
    traces: int = 0
    """results whose traces were deleted"""
    dropped: int = 0
    """artifacts of kept results whose bytes were deleted"""
    stages: dict[str, dict[str, int]] = field(default_factory=dict)
    """stage -> files and bytes; names in parentheses are no stages"""
    dry_run: bool = False

    def add(self, owner: str, path: Path) -> None:
        """Delete a file, or with `dry_run` only count it."""
        with suppress(FileNotFoundError):
            size = path.stat().st_size
            if not self.dry_run:
                path.unlink()
            row = self.stages.setdefault(owner, {"files": 0, "bytes": 0})
            row["files"], row["bytes"] = row["files"] + 1, row["bytes"] + size
            self.files, self.bytes = self.files + 1, self.bytes + size


def collect_garbage(store: Store, index: Index, rules: Rules, dry_run: bool = False) -> GcResult:
    """Delete what the rules do not keep; with `dry_run`, count it. The caller holds the store's lease alone.

    UnknownStageError when a stage of `drop` has no task in the store.
    """
    _check_stages(index, rules.drop)
    swept, kept = GcResult(dry_run=dry_run), kept_keys(index, rules)
    traces = list(index.all())
    reach = _Reach(store, [trace for trace in traces if trace.key in kept], frozenset(rules.drop))
    doomed = _doomed_blobs(store, reach, _owners(store, traces))
    gone = _dropped(store, reach, {blob for blob, _ in doomed})
    swept.traces, swept.dropped = len(traces) - len(reach.traces), sum(map(len, gone.values()))
    if not dry_run and (gone or swept.traces or len(segment_names(index.root)) > 1):
        # before any blob: a kill in between leaves blobs without rows, which the next gc deletes
        drops = {digest: stage for stage, digests in gone.items() for digest in digests}
        drops |= {digest: stage for digest, stage in index.drops.items() if store.lost(digest)}
        rewrite(index, list(_kept_rows(index, kept, reach.artifacts | reach.dropped.keys(), drops)))
    for blob, owner in doomed:
        swept.add(owner, store.path("blobs", blob))
    _delete_rest(store.root, {trace.code for trace in reach.traces}, swept)
    if not dry_run:
        store.renew()
        store.save()
    return swept


def kept_keys(index: Index, rules: Rules) -> set[str]:
    """Keys whose results are kept.

    The last use of a key that another one has replaced is not recorded for runs with nothing to do. It is therefore taken as the
    first use of its successor, and so never too early.
    """
    kept, now = set[str](), time.time()
    for uses in index.uses().values():
        newest = sorted(uses.items(), key=lambda use: use[1], reverse=True)
        kept |= {key for key, _ in newest[:max(1, rules.keep_last)]}
        if rules.older_than_days:
            since = now - rules.older_than_days * DAY_S
            kept |= {key for (key, _), (_, until) in zip(newest[1:], newest, strict=False) if until > since}
    return kept


def _check_stages(index: Index, stages: Iterable[str]) -> None:
    known = set(index.stages())
    for stage in stages:
        if stage not in known:
            there = ", ".join(sorted(known)) or "none"
            raise UnknownStageError(f"--drop {stage}: no task of this stage is in the store; its stages are: {there}")


class _Reach:
    """Artifacts and blobs that the kept traces need.

    `dropped` maps artifacts whose bytes may go to their stage. An artifact that another kept result has made stays.
    """

    def __init__(self, store: Store, traces: list[Trace], drop: frozenset[str]) -> None:
        self.traces, self.artifacts = traces, set[str]()
        self.dropped: dict[str, str] = {}
        self._store = store
        dropping = [trace for trace in traces if trace.stage in drop]
        for trace in traces:
            if trace.stage not in drop:
                self._reach(trace.output)
        for trace in dropping:
            self.dropped |= {inside: trace.stage for inside, _ in store.closure(trace.output) if inside not in self.artifacts}
        for trace in traces:
            for digest in trace.inputs.values():
                self._reach(digest)
        self.blobs = {entry.blob for digest in self.artifacts for entry in _files(store.find(digest)) if not entry.path}

    def _reach(self, digest: str) -> None:
        if digest in self.artifacts or digest in self.dropped:
            return
        self.artifacts.add(digest)
        found = self._store.find(digest)
        for _, child in (found.children or ()) if found else ():
            self._reach(child)


def _files(found: Manifest | None) -> tuple[Any, ...]:
    return found.files if found else ()


def _owners(store: Store, traces: Iterable[Trace]) -> dict[str, str]:
    """Blob -> stage that made it first."""
    owners: dict[str, str] = {}
    seen: set[str] = set()
    for trace in sorted(traces, key=lambda trace: trace.finished):
        for digest, found in store.closure(trace.output) if trace.output not in seen else ():
            seen.add(digest)
            for entry in _files(found):
                owners.setdefault(entry.blob, trace.stage)
    return owners


def _doomed_blobs(store: Store, reach: _Reach, owners: dict[str, str]) -> list[tuple[str, str]]:
    """(blob, stage that made it) of all blobs that nothing needs.

    Blobs with another link are published files, whose bytes would stay on the disk; they are kept if a kept result is made of them.
    """
    dropped = {entry.blob for digest in reach.dropped for entry in _files(store.find(digest))}
    doomed = []
    for path in stored(store.root / "blobs"):
        blob = path.parent.name + path.name
        if blob not in reach.blobs and not (blob in dropped and path.stat().st_nlink > 1):
            doomed.append((blob, owners.get(blob, ELSEWHERE)))
    return doomed


def _dropped(store: Store, reach: _Reach, doomed: set[str]) -> dict[str, list[str]]:
    """Stage -> artifacts of kept results that will not be readable any more."""
    gone: dict[str, list[str]] = {}
    for digest, stage in reach.dropped.items():
        if any(entry.blob in doomed for entry in _files(store.find(digest))):
            gone.setdefault(stage, []).append(digest)
    return gone


def _delete_rest(root: Path, codes: set[str], swept: GcResult) -> None:
    """Delete unused definitions, damaged and torn files, folders of stages, and old runs."""
    for path in (root / "code").iterdir():
        if path.stem not in codes:
            swept.add(CODE, path)
    for path in (*(root / "damaged").iterdir(), *(root / "traces").glob(".*"), *(root / "blobs").glob("??/.*")):
        swept.add(DAMAGED, path)
    for path in list(expired(root)):
        swept.add(HISTORY, path)
    for folder in (root / "scratch").iterdir():
        for path in [folder] if folder.is_file() else [path for path in folder.rglob("*") if path.is_file()]:
            swept.add(SCRATCH, path)
        if not swept.dry_run:
            shutil.rmtree(folder, ignore_errors=True)


def _kept_rows(index: Index, keys: set[str], artifacts: set[str], drops: dict[str, str]) -> Iterator[list[Any]]:
    """Rows of the kept traces and artifacts, and of their uses; failures are not kept."""
    rows = [row for name in segment_names(index.root) for _, line in lines(read_from(index.root, name, 0)) if (row := decode(line))]
    specs = {row[3] for row in rows if row[0] == "trace" and row[1] in keys}
    wanted = {"trace": (1, keys), "artifact": (1, artifacts), "spec": (1, specs), "use": (3, keys)}
    for row in rows:
        at, names = wanted.get(row[0], (0, set[str]()))
        if row[at] in names:
            yield row
    yield from (["drop", stage, digest, time.time()] for digest, stage in drops.items() if digest in artifacts)


def stored(blobs: Path) -> Iterator[Path]:
    """Yield the paths of all blobs."""
    for prefix in sorted(os.listdir(blobs)):
        if len(prefix) == 2:
            yield from (blobs / prefix / name for name in sorted(os.listdir(blobs / prefix)) if not name.startswith("."))
