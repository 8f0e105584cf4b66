"""Store maintenance: lineage of artifacts, verification, and garbage collection."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from runner.canonical import file_digest, path_digest
from runner.files import host
from runner.lease import Lease
from runner.store import Entry, Store
from runner.task_planner import kept_definitions
from runner.traces import Trace, Traces

DAY_S = 86400.0


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


@dataclass
class GcResult:
    """Number and size of files that gc deleted, or would delete."""

    files: int = 0
    bytes: int = 0
    dry_run: bool = False


def lineage(store: Store, traces: Traces, artifact: str) -> Provenance:
    """Provenance of an artifact.

    ValueError when no artifact, or more than one, has a digest with this prefix.
    """
    makers: dict[str, Trace] = {}
    for trace in sorted(traces.all(), key=lambda trace: trace.finished):
        for inside, _ in store.closure(trace.output):
            makers.setdefault(inside, trace)  # the first producer: a later stage may return it unchanged
    return _origin(store, makers, _named(store, artifact), {})


def _origin(store: Store, makers: dict[str, Trace], digest: str, done: dict[str, Provenance]) -> Provenance:
    if digest not in done:
        done[digest] = Provenance(digest, "(itself)", None)  # ends the recursion for an output equal to one of its inputs
        found, trace = store.find(digest), makers.get(digest)
        sources = trace.inputs.items() if trace else (found.children or ()) if found else ()
        inputs = tuple((name, _origin(store, makers, source, done)) for name, source in sources)
        files = tuple(entry.path for entry in found.files if entry.path) if found else ()
        done[digest] = Provenance(digest, found.kind if found else "(gone)", trace, inputs, files)
    return done[digest]


def _named(store: Store, artifact: str) -> str:
    """Digest of the artifact at a digest prefix, or at the path of a manifest or blob."""
    path = Path(artifact)
    if path.exists() and path.resolve().is_relative_to(store.root.resolve()):
        room, *parts = path.resolve().relative_to(store.root.resolve()).parts
        name = "".join(parts).removesuffix(".json")
        return name if room == "manifests" else _holder(store, name)
    matches = [digest for digest in _stored(store.root / "manifests") if digest.startswith(artifact)]
    if len(matches) != 1:
        raise ValueError(f"expected the digest of one artifact, a prefix of it, or a path in the store; {artifact!r} matches "
                         f"{len(matches)} artifacts")
    return matches[0]


def _holder(store: Store, blob: str) -> str:
    for digest in _stored(store.root / "manifests"):
        found = store.find(digest)
        if found and any(entry.blob == blob for entry in found.files):
            return digest
    raise ValueError(f"no artifact holds the blob {blob[:12]}")


def verify(store: Store, traces: Traces) -> VerifyResult:
    """Read every blob and trace, and check every artifact in use.

    A damaged trace is rewritten from the index; without entry there it is deleted, and its task runs again. Damaged definitions
    for `explain` are deleted, since nothing depends on them.
    """
    verdict = VerifyResult()
    store.distrust()
    verdict.missing += [f"trace {key[:12]} (damaged)" for key in traces.mend()]
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
    for digest in _reached(store, traces):
        found = store.find(digest)
        if found is None:
            verdict.missing.append(f"manifest of {digest[:12]}")
            continue
        for entry in found.files:
            _check(store, entry, digest, verdict)
    return verdict


def _check(store: Store, entry: Entry, digest: str, verdict: VerifyResult) -> None:
    if not entry.path:
        if not store.path("blobs", entry.blob).exists() and entry.blob not in verdict.damaged:
            verdict.missing.append(f"{entry.name} of {digest[:12]}")
        return
    path = Path(entry.path)
    if not path.exists() or path_digest(path) != entry.blob:
        verdict.changed.append(entry.path)


def gc(store: Store, traces: Traces, dry_run: bool = False) -> GcResult:
    """Keep what the last use of every shard reaches: traces, outputs, inputs. Delete the rest.

    With `dry_run` the rest is only counted.
    """
    swept = GcResult(dry_run=dry_run)
    if not dry_run:
        traces.mend()
    keep = set(_reached(store, traces))
    blobs = {entry.blob for digest in keep if (found := store.find(digest)) for entry in found.files}
    for trace in list(traces.all()):
        if trace.key not in traces.latest_keys():
            _drop(store.path("traces", trace.key, ".json"), swept)
            if not dry_run:
                traces.forget(trace.key)
    for room, kept, suffix in (("manifests", keep, ".json"), ("blobs", blobs, ""), ("damaged", set(), "")):
        for name in list(_stored(store.root / room)) if room != "damaged" else [p.name for p in (store.root / room).iterdir()]:
            if name not in kept:
                _drop(store.root / room / name if room == "damaged" else store.path(room, name, suffix), swept)
    codes = {f"{trace.code}.json" for trace in traces.all() if trace.key in traces.latest_keys()}
    unused = [path for path in (store.root / "code").glob("*") if path.name not in codes]
    for old in (*unused, *(store.root / "failures").glob("??/*.json")):
        _drop(old, swept)
    for torn in (path for room in ("blobs", "manifests", "traces", "failures") for path in (store.root / room).glob("??/.*")):
        _drop(torn, swept)
    for folder in (store.root / "scratch").iterdir():
        swept.bytes += sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
        if not dry_run:
            shutil.rmtree(folder, ignore_errors=True)
    if dry_run:
        return swept
    store.forget_all()
    store.save()
    traces.save()
    return swept


def _drop(path: Path, swept: GcResult) -> None:
    with suppress(FileNotFoundError):
        swept.bytes += path.stat().st_size
        swept.files += 1
        if not swept.dry_run:
            path.unlink()


def sweep(root: Path) -> None:
    """Remove leftovers of killed runs: save folders and lock files without owner.

    No run may be open.
    """
    for folder in (root / "scratch").glob("save*"):
        if not _has_owner(folder):
            shutil.rmtree(folder, ignore_errors=True)
    for path in (root / "leases").glob("?" * 64 + ".lock"):
        lease = Lease(path)
        if lease.held:
            lease.release()


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


def _reached(store: Store, traces: Traces) -> Iterator[str]:
    """Yield artifacts that the last use of every shard produced or used."""
    seen: set[str] = set()
    for key in traces.latest_keys():
        trace = traces.get(key)
        for digest in (trace.output, *trace.inputs.values()) if trace else ():
            for inside, _ in store.closure(digest):
                if inside not in seen:
                    seen.add(inside)
                    yield inside


def _stored(folder: Path) -> Iterator[str]:
    """Yield digests in a folder that is split by their first two letters."""
    for path in folder.glob("??/*"):
        if not path.name.startswith("."):
            yield path.parent.name + path.name.removesuffix(".json")
