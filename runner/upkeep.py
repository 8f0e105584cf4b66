"""Store maintenance: lineage of artifacts, verification, and garbage collection."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from runner.canonical import file_digest, path_digest
from runner.files import host, unique, write_atomic
from runner.index import Entry, Index, Trace
from runner.lease import has_writer
from runner.segments import SUFFIX, decode, encode, lines, new_session, read_from, segment_names
from runner.store import Store
from runner.task_planner import kept_definitions

DAY_S = 86400.0
MANY_SEGMENTS = 32
"""segments are merged when a run begins alone and there are more"""


@dataclass(frozen=True)
class Provenance:
    """Artifact and its inputs.

    `trace` is None for a leaf, a value from outside.
    """

    digest: str
    kind: str
    trace: Trace | None
    inputs: tuple[tuple[str, Provenance], ...] = ()
    """(argument, its provenance); for a composite without a producing stage, (element, its provenance)"""
    files: tuple[str, ...] = ()
    """a leaf's files outside the store"""


@dataclass
class VerifyResult:
    """Result of `verify`."""

    blobs: int = 0
    bytes: int = 0
    damaged: list[str] = field(default_factory=list)
    """blobs moved aside"""
    missing: list[str] = field(default_factory=list)
    """missing files of artifacts in use; damaged manifests and traces"""
    changed: list[str] = field(default_factory=list)
    """leaf files outside the store that have changed"""

    @property
    def ok(self) -> bool:
        """True when nothing is damaged, missing or changed."""
        return not (self.damaged or self.missing or self.changed)


def lineage(store: Store, index: Index, artifact: str) -> Provenance:
    """Provenance of an artifact.

    ValueError when no artifact, or more than one, has a digest with this prefix.
    """
    return _origin(store, _makers(store, index), _named(store, index, artifact), {})


def leafs(store: Store, index: Index, artifacts: Iterable[str]) -> dict[str, frozenset[str]]:
    """Artifact -> digests of the leafs that it was computed from."""
    makers, done, found = _makers(store, index), dict[str, Provenance](), dict[str, frozenset[str]]()

    def below(one: Provenance) -> frozenset[str]:
        if one.digest not in found:
            found[one.digest] = frozenset[str]()  # ends the recursion for an output equal to one of its inputs
            own = frozenset((one.digest,)) if one.trace is None else frozenset[str]()
            found[one.digest] = own.union(*(below(part) for _, part in one.inputs))
        return found[one.digest]

    return {artifact: below(_origin(store, makers, artifact, done)) for artifact in artifacts}


def _makers(store: Store, index: Index) -> dict[str, Trace]:
    """Digest of an artifact or a part of one -> its first producer, since a later stage may return it unchanged."""
    makers: dict[str, Trace] = {}
    for trace in sorted(index.all(), key=lambda trace: trace.finished):
        for inside, _ in store.closure(trace.output):
            makers.setdefault(inside, trace)
    return makers


def _origin(store: Store, makers: dict[str, Trace], digest: str, done: dict[str, Provenance]) -> Provenance:
    if digest not in done:
        done[digest] = Provenance(digest, "(itself)", None)  # ends the recursion for an output equal to one of its inputs
        found, trace = store.find(digest), makers.get(digest)
        sources = trace.inputs.items() if trace else (found.children or ()) if found else ()
        inputs = tuple((name, _origin(store, makers, source, done)) for name, source in sources)
        files = tuple(entry.path for entry in found.files if entry.path) if found else ()
        done[digest] = Provenance(digest, found.kind if found else "(gone)", trace, inputs, files)
    return done[digest]


def _named(store: Store, index: Index, artifact: str) -> str:
    """Digest of the artifact at a digest prefix, or at the path of a blob."""
    path = Path(artifact)
    if path.exists() and path.resolve().is_relative_to(store.root.resolve()):
        _, *parts = path.resolve().relative_to(store.root.resolve()).parts
        return _holder(index, "".join(parts))
    matches = [digest for digest in index.bodies() if digest.startswith(artifact)]
    if len(matches) != 1:
        raise ValueError(f"expected the digest of one artifact, a prefix of it, or a path in the store; {artifact!r} matches "
                         f"{len(matches)} artifacts")
    return matches[0]


def _holder(index: Index, blob: str) -> str:
    found = next((digest for digest, body in index.bodies().items() if blob and blob in body), None)
    if found is None:
        raise ValueError(f"no artifact holds the blob {blob[:12]}")
    return found


def verify(store: Store, index: Index) -> VerifyResult:
    """Read every segment and blob, and check every artifact in use.

    Damaged rows of segments are removed, and their tasks run again. Damaged definitions for `explain` are deleted, since nothing
    depends on them. Damaged blobs are computed again by the next run, missing ones when a task needs them. With a remote store,
    a blob that is not here is not missing: most of them are never fetched.
    """
    verdict = VerifyResult()
    index.load(cached=False)
    verdict.missing += [f"{count} row(s) of {name} (damaged)" for name, count in sorted(index.damaged.items())]
    mend(index)
    index.write()
    store.renew()
    for path in (store.root / "code").glob("[!.]*.json"):
        if kept_definitions(store.root, path.stem) is None:
            path.unlink()
    for blob in list(_stored(store.root / "blobs")):
        path = store.path("blobs", blob)
        verdict.blobs += 1
        verdict.bytes += path.stat().st_size
        if file_digest(path) != blob:
            store.quarantine(blob)
            verdict.damaged.append(blob)
    for digest in _reached(store, index):
        found = store.find(digest)
        if found is None:
            verdict.missing.append(f"manifest of {digest[:12]}")
            continue
        gone = [entry for entry in found.files if not _check(store, entry, digest, verdict, digest in index.drops)]
        if gone and digest not in index.drops and not any(store.was_damaged(entry.blob) for entry in gone):
            index.drop("", [digest])
    return verdict


def _check(store: Store, entry: Entry, digest: str, verdict: VerifyResult, dropped: bool) -> bool:
    """Check one file of an artifact; False when its blob is gone."""
    if not entry.path:
        if store.path("blobs", entry.blob).exists() or (store.remote is not None and entry.blob not in verdict.damaged):
            return True
        if not dropped and entry.blob not in verdict.damaged:
            verdict.missing.append(f"{entry.name} of {digest[:12]}")
        return False
    path = Path(entry.path)
    if not path.exists() or path_digest(path) != entry.blob:
        verdict.changed.append(entry.path)
    return True


def mend(index: Index) -> None:
    """Rewrite the damaged segments of writers that have ended, without their damaged rows."""
    for name in [name for name in index.damaged if not has_writer(index.root / "traces" / name)]:
        kept = b"".join(line + b"\n" for _, line in lines(read_from(index.root, name, 0)) if decode(line) is not None)
        write_atomic(index.root / "traces" / name, kept)
        del index.damaged[name]
    index.load(cached=False)


def merge(index: Index) -> None:
    """Merge all segments into one, without replaced rows; no run may be open."""
    names = segment_names(index.root)
    found = (decode(line) for name in names for _, line in lines(read_from(index.root, name, 0)))
    rewrite(index, (row for row in found if row is not None))


def rewrite(index: Index, rows: Iterable[list[Any]]) -> None:
    """Replace all segments by one with these rows; no run may be open.

    The new segment is complete before an old one is deleted, so a kill in between loses nothing.
    """
    old = segment_names(index.root)
    name = f"{new_session()}-{os.getpid()}{SUFFIX}"
    hidden = index.root / "traces" / unique(name)
    with open(hidden, "wb") as file:
        for row in rows:
            file.write(encode(row))
    os.replace(hidden, index.root / "traces" / name)
    index.writer.close()
    for former in old:
        (index.root / "traces" / former).unlink(missing_ok=True)
    index.load(cached=False)
    index.write()


def sweep(root: Path, index: Index) -> None:
    """Remove leftovers of killed runs, mend damaged segments, and merge segments when there are many.

    No run may be open.
    """
    for folder in (root / "scratch").glob("save*"):
        if not _has_owner(folder):
            shutil.rmtree(folder, ignore_errors=True)
    if index.damaged:
        mend(index)
    if len(segment_names(root)) > MANY_SEGMENTS:
        merge(index)


def _has_owner(folder: Path) -> bool:
    """Return True when the process in the folder's name may still exist: it lives, or is on another host with work today."""
    where, _, rest = folder.name.partition(".")[2].rpartition("-")[0].rpartition("-")
    if where == host() and rest.isdigit() and os.path.isdir("/proc/self"):
        return _lives(rest)
    with suppress(FileNotFoundError):
        return time.time() - folder.stat().st_mtime < DAY_S
    return False


def _lives(process: str) -> bool:
    """Return True for an existing process that has not ended (a zombie has)."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False


def _reached(store: Store, index: Index) -> Iterator[str]:
    """Yield artifacts that the last use of every shard produced or used."""
    seen: set[str] = set()
    keys = index.latest_keys()
    for trace in index.all():
        for digest in (trace.output, *trace.inputs.values()) if trace.key in keys else ():
            for inside, _ in store.closure(digest) if digest not in seen else ():
                if inside not in seen:
                    seen.add(inside)
                    yield inside


def _stored(folder: Path) -> Iterator[str]:
    """Yield digests in a folder that is split by their first two letters."""
    for path in folder.glob("??/*"):
        if not path.name.startswith("."):
            yield path.parent.name + path.name.removesuffix(".json")
