"""Content-addressed store of blobs, with a manifest for each typed value.

    blobs/ab/cdef...        bytes named by their BLAKE3 digest, read-only, put in place by rename
    traces/                 segments with manifests and traces (`runner.segments`)
    damaged/                blobs whose bytes do not match their name

An artifact is named by the digest of its logical content. Early cut-off therefore works per element and per field of a composite,
independent of the codec's file layout. Files of leaf values are never copied: their manifest refers to them. Every file is hashed
before it is read; a blob that does not match is moved aside, and `LostError` is raised. A blob that is missing here is taken from
the remote store, if there is one.
"""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol

from blake3 import blake3

from runner.canonical import CHUNK_BYTES, file_digest
from runner.canonical import digest as tagged
from runner.codec import Codec
from runner.files import FORMAT, DamagedError, FileMemo, VerifiedBlobs, read_cache, stamp, unique, write_cache
from runner.index import Entry, Index, Manifest, manifest_of

FETCHED_TOGETHER = 4
"""files that are fetched from the remote store at once"""
FOLDERS = ("blobs", "traces", "leases", "scratch", "damaged", "code", ".cache")


class StoreError(OSError):
    """The store cannot be used; the message says what to do."""


class LostError(Exception):
    """An artifact cannot be read; `damaged` distinguishes a broken blob from a missing one.

    `also` lists other artifacts that were found to be unreadable at the same time.
    """

    def __init__(self, digest: str, damaged: bool, what: str, also: tuple[str, ...] = ()) -> None:
        super().__init__(digest, damaged, what, also)
        self.digest, self.damaged, self.what, self.also = digest, damaged, what, also

    def __str__(self) -> str:
        return f"artifact {self.digest[:12]} is {'damaged' if self.damaged else 'missing'}: {self.what}"


class Catalog(Protocol):
    """Manifests by artifact: the index in a scheduler, those of one job in a worker."""

    def body(self, digest: str) -> str | None:
        """Encoded manifest; None for an unknown artifact."""

    def has_artifact(self, digest: str) -> bool:
        """Return True when the scheduler of this run knows the artifact, so that it need not be recorded."""

    def add_artifact(self, digest: str, manifest: Manifest) -> None:
        """Record an artifact."""


class Remote(Protocol):
    """Blobs of a remote store."""

    @property
    def online(self) -> bool:
        """False while the remote store cannot be reached."""

    def pull(self, blob: str, place: Path) -> bool:
        """Fetch a blob and verify it; False when the remote store lacks it."""


class Store:
    """Blobs and manifests under one folder; without a catalog, the index of the folder is read."""

    def __init__(self, root: Path, codec: Codec, catalog: Catalog | None = None, rehash: bool = False, plan_only: bool = False,
                 remote: Remote | None = None) -> None:
        self.root, self.codec, self.remote = root, codec, remote
        self.catalog: Catalog = Index(root) if catalog is None else catalog
        self.memo = FileMemo(root, rehash, plan_only)
        self._blobs = f"{root}/blobs"
        self._verified_blobs = VerifiedBlobs(root)
        self._absent: set[str] = set()
        """blobs that neither this store nor the remote one has"""
        self._valid: set[str] = set()
        """plain artifacts whose files were found unchanged since `renew`"""
        self._kinds: dict[str, frozenset[str]] = {}
        self._planned: dict[str, Manifest] = {}
        """manifests of a plan, which writes nothing"""
        self._recent: dict[str, object] = {}
        self._folder = str(root / "scratch" / unique("save")[1:])
        self._folder_is_clean = False

    # -- writing ---------------------------------------------------------------------------------------------------

    def put(self, value: object, scratch: Path) -> str:
        """Store the output of a stage.

        Files in the stage's private folder `scratch` are moved, not copied. A file may occur in several parts of the
        output.
        """
        return self._put(value, scratch, {})

    def _put(self, value: object, scratch: Path, moved: dict[str, Entry]) -> str:
        parts = self.codec.children(value)
        if parts is not None:
            return self._put_composite(self.codec.kind(value), [(name, self._put(part, scratch, moved)) for name, part in parts])
        with self._saved(value) as files:
            entries = tuple(self._take_link(path, name, scratch, moved) if linked else self._take(path, name)
                            for name, path, linked in files)
        return self._put_manifest(self.codec.digest(value), Manifest(self.codec.kind(value), entries))

    def put_leaf(self, value: object) -> str:
        """Store a value from outside.

        Files that the codec writes become blobs; linked files stay where they are.
        """
        parts = self.codec.children(value)
        if parts is not None:
            return self._put_composite(self.codec.kind(value), [(name, self.put_leaf(part)) for name, part in parts])
        digest = self.codec.digest(value)
        body = self.catalog.body(digest)
        if body is not None and self._leaf_is_valid(digest, body):
            return digest
        if self.memo.plan_only:
            return self._put_manifest(digest, Manifest(self.codec.kind(value)))
        with self._saved(value) as files:
            entries = tuple(self._refer(path, name) if linked else self._take(path, name) for name, path, linked in files)
        known = self.find(digest)
        before = {entry.name: entry.blob for entry in known.files} if known else {}
        for entry in entries:
            if entry.path and before.get(entry.name, entry.blob) != entry.blob:
                raise StoreError(errno.ESTALE, f"{entry.path} changed since its digest was computed; run again")
        return self._put_manifest(digest, Manifest(self.codec.kind(value), entries))

    def _leaf_is_valid(self, digest: str, body: str) -> bool:
        """Return True when the leaf need not be stored again: its bytes are here, or it is referred to and unchanged."""
        return self.state(digest) == "ok" and (body[:1] != "[" or all(map(self.present, manifest_of(body).files)))

    def put_tuple(self, children: list[tuple[str, str]]) -> str:
        """Store a composite of stored artifacts."""
        return self._put_composite("tuple", children)

    def _put_composite(self, kind: str, children: list[tuple[str, str]]) -> str:
        names = {name for name, _ in children}
        if len(names) != len(children):
            found = [name for name, _ in children]
            twice = min(name for name in names if found.count(name) > 1)
            raise ValueError(f"elements of a {kind} must have different names, got {twice!r} more than once")
        digest = tagged("afford-composite", [kind, children])
        known = self.catalog.has_artifact(digest) or digest in self._planned
        return digest if known else self._put_manifest(digest, Manifest(kind, children=tuple(children)))

    def _put_manifest(self, digest: str, manifest: Manifest) -> str:
        if self.memo.plan_only:  # a plan writes nothing: digests of files that it has not read are stand-ins
            self._planned[digest] = manifest
        else:
            self.catalog.add_artifact(digest, manifest)
            self._valid.discard(digest)
        return digest

    @contextmanager
    def _saved(self, value: object) -> Iterator[list[tuple[str, str, bool]]]:
        """Save a value with the codec; yield (name, path, is a link) of its files.

        The folder belongs to this process and is reused, since creating and removing one costs more than the rest.
        """
        if not self._folder_is_clean:
            shutil.rmtree(self._folder, ignore_errors=True)
            os.makedirs(self._folder)
        self._folder_is_clean = False
        self.codec.save(value, Path(self._folder))
        files = _files_in(self._folder)
        yield files
        for _, path, linked in files:
            if linked and os.path.islink(path):
                os.unlink(path)
        self._folder_is_clean = not any("/" in name for name, _, _ in files)

    def _take(self, path: str, name: str) -> Entry:
        """Move a file into the store.

        An intact blob with the same bytes stays: replacing a file makes some file systems write the new one out at once.
        """
        blob, size = _digest_of(path)
        place = self._place(blob)
        if os.path.exists(place) and _digest_of(place)[0] == blob:
            os.unlink(path)
            return Entry(name, blob, size, os.stat(place).st_ctime_ns)
        os.chmod(path, 0o444)
        try:
            os.replace(path, place)
        except FileNotFoundError:
            os.makedirs(os.path.dirname(place), exist_ok=True)
            os.replace(path, place)
        return Entry(name, blob, size, os.stat(place).st_ctime_ns)

    def _take_link(self, path: str, name: str, scratch: Path, moved: dict[str, Entry]) -> Entry:
        """Store a linked file: it is moved from the task's own scratch folder, a blob is used again, anything else is copied."""
        source = os.path.realpath(path)
        if source in moved:
            return moved[source]._replace(name=name)
        if source.startswith(f"{os.path.realpath(scratch)}/"):
            moved[source] = self._take(source, name)
            return moved[source]
        held = self._held(Path(source))
        if held is not None:
            found = os.stat(source)
            return Entry(name, held, found.st_size, found.st_ctime_ns)
        os.unlink(path)
        shutil.copyfile(source, path)
        return self._take(path, name)

    def _held(self, source: Path) -> str | None:
        """Digest of a file that is a blob of this store and matches its name."""
        blobs = (self.root / "blobs").resolve()
        if not source.is_relative_to(blobs):
            return None
        named = "".join(source.relative_to(blobs).parts)
        return named if file_digest(source) == named else None

    def _refer(self, path: str, name: str) -> Entry:
        target = Path(path).resolve()
        blob, size = self.memo.digest(target)
        return Entry(name, blob, size, 0, str(target), stamp(target))

    # -- reading ---------------------------------------------------------------------------------------------------

    def find(self, digest: str) -> Manifest | None:
        """Manifest of an artifact; None when it is unknown."""
        body = self.catalog.body(digest)
        return self._planned.get(digest) if body is None else manifest_of(body)

    def manifest(self, digest: str) -> Manifest:
        """Manifest of an artifact; LostError when there is none."""
        found = self.find(digest)
        if found is None:
            raise LostError(digest, False, "its manifest is gone")
        return found

    def closure(self, digest: str) -> Iterator[tuple[str, Manifest | None]]:
        """Yield the artifact and, recursively, the parts of a composite one."""
        found = self.find(digest)
        yield digest, found
        for _, child in (found.children or ()) if found else ():
            yield from self.closure(child)

    def kinds(self, digest: str) -> frozenset[str]:
        """Schemas that occur in an artifact."""
        body = self.catalog.body(digest)
        if body is not None and body[:1] != "[":
            kind = body.partition("\t")[0]
            return self._kinds.get(kind) or self._kinds.setdefault(kind, frozenset((kind,)))
        return frozenset(found.kind for _, found in self.closure(digest) if found)

    def files(self, digest: str) -> dict[str, Path]:
        """Map name to verified path for every file of a plain artifact; LostError when one is missing or damaged."""
        return {entry.name: self._verified(digest, entry) for entry in self.manifest(digest).files}

    def file(self, digest: str, name: str) -> Path:
        """Verified path of one file of a plain artifact.

        KeyError for an unknown name, LostError when the file is missing or damaged.
        """
        entries = {entry.name: entry for entry in self.manifest(digest).files}
        return self._verified(digest, entries[name])

    def unverified_files(self, digest: str) -> dict[str, Path]:
        """Map name to path for every file of a plain artifact; nothing is read, and a file may be missing."""
        return {entry.name: Path(entry.path) if entry.path else self.path("blobs", entry.blob)
                for entry in self.manifest(digest).files}

    def load(self, digest: str) -> object:
        """Load the value from verified files."""
        if digest in self._recent:
            return self._recent[digest]
        found = self.manifest(digest)
        if found.children is not None:
            return self.codec.combine(found.kind, [(name, self.load(child)) for name, child in found.children])
        return self.codec.load(found.kind, {entry.name: self._verified(digest, entry) for entry in found.files})

    def load_inputs(self, inputs: Mapping[str, str]) -> dict[str, object]:
        """Load the inputs of a task.

        They are kept until the next call, since the stages of one clip share them.
        """
        self._recent = {digest: self._recent[digest] for digest in inputs.values() if digest in self._recent}
        for digest in inputs.values():
            self._recent[digest] = self.load(digest)
        return {name: self._recent[digest] for name, digest in inputs.items()}

    def _verified(self, digest: str, entry: Entry) -> Path:
        if entry.path:
            return self._verified_leaf(digest, entry)
        path = Path(self._place(entry.blob))
        try:
            if _digest_of(str(path))[0] == entry.blob:
                return path
        except FileNotFoundError:
            return self._pulled(digest, entry, path)
        self.quarantine(entry.blob)
        raise LostError(digest, True, f"{entry.name} did not match its digest and was moved to damaged/")

    def _pulled(self, digest: str, entry: Entry, path: Path) -> Path:
        """Fetch a file that is missing here; LostError when the remote store lacks it, too."""
        damaged = self.was_damaged(entry.blob)
        try:
            if self.remote is not None and self.remote.pull(entry.blob, path):
                return path
        except DamagedError:
            damaged = True
        self._absent.add(entry.blob)
        raise LostError(digest, damaged, f"{entry.name} is not in the store")

    def fetch(self, digests: Iterable[str]) -> None:
        """Fetch all missing files of artifacts from the remote store, several at once.

        LostError with all artifacts that neither store has.
        """
        missing = {(inside, entry) for digest in digests for inside, found in self.closure(digest)
                   for entry in (found.files if found else ()) if not entry.path and not os.path.exists(self._place(entry.blob))}
        if not missing:
            return
        from concurrent.futures import ThreadPoolExecutor  # takes a tenth of a run with nothing to do

        with ThreadPoolExecutor(FETCHED_TOGETHER) as pool:
            lost = sorted(error.args for error in pool.map(self._fetch, missing) if error is not None)
        if lost:
            digest, damaged, what, _ = lost[0]
            raise LostError(digest, damaged, what, tuple(dict.fromkeys(other[0] for other in lost[1:])))

    def _fetch(self, wanted: tuple[str, Entry]) -> LostError | None:
        digest, entry = wanted
        try:
            self._pulled(digest, entry, Path(self._place(entry.blob)))
        except LostError as error:
            return error
        return None

    def _verified_leaf(self, digest: str, entry: Entry) -> Path:
        path = Path(entry.path)
        try:
            if stamp(path) == entry.stamp or self.memo.digest(path)[0] == entry.blob:
                return path
        except FileNotFoundError:
            raise LostError(digest, False, f"{path} is gone") from None
        raise LostError(digest, True, f"{path} changed after the run began")

    # -- state of the files ----------------------------------------------------------------------------------------

    def state(self, digest: str) -> str:
        """'ok', 'lost' or 'damaged': state of the files of an artifact, or 'unknown' without a complete manifest.

        Bytes are read again only where a file's size or change time differs. A damaged blob is moved aside.
        """
        if digest in self._valid:
            return "ok"
        body = self.catalog.body(digest)
        if body is None:
            return "ok" if digest in self._planned else "unknown"
        if body[:1] != "[":
            worst = self._plain_state(body)
            if worst == "ok":
                self._valid.add(digest)
            return worst
        found = manifest_of(body)
        states = {self._entry_state(entry) for entry in found.files} | {self.state(child) for _, child in found.children or ()}
        return next((state for state in ("unknown", "damaged", "lost") if state in states), "ok")

    def _plain_state(self, body: str) -> str:
        fields, worst = body.split("\t"), "ok"
        if len(fields) == 5:  # one file, as most artifacts have
            return self._blob_state(fields[2], int(fields[3]), int(fields[4]))
        for at in range(1, len(fields), 4):
            blob = fields[at + 1]
            state = self._blob_state(blob, int(fields[at + 2]), int(fields[at + 3]))
            worst = worst if state == "ok" else state
        return worst

    def _entry_state(self, entry: Entry) -> str:
        if entry.path:
            return "ok" if self.present(entry) else "lost"
        return self._blob_state(entry.blob, entry.size, entry.changed)

    def _blob_state(self, blob: str, size: int, changed: int) -> str:
        path = f"{self._blobs}/{blob[:2]}/{blob[2:]}"
        try:
            found = os.stat(path)
            if found.st_ctime_ns == changed and found.st_size == size:
                return "ok"
            if self._verified_blobs.same(blob, found):
                return "ok"
            if file_digest(Path(path)) == blob:
                self._verified_blobs.note(blob, path)
                return "ok"
        except FileNotFoundError:
            if self.remote is not None and self.remote.online and blob not in self._absent:
                return "ok"  # it is there, since a trace follows its blobs; `_verified` fetches it
            return "damaged" if self.was_damaged(blob) else "lost"
        self.quarantine(blob)
        return "damaged"

    def lost(self, digest: str) -> list[str]:
        """Plain artifacts in an artifact whose files cannot be read, and parts without manifest."""
        if self.state(digest) == "ok":
            return []
        found = self.find(digest)
        if found is None or found.children is None:
            return [digest]
        return [inside for _, child in found.children for inside in self.lost(child)]

    def forget(self, digest: str) -> None:
        """Check the files of an artifact again next time, also in the remote store, to which a worker may have pushed them."""
        for inside, found in self.closure(digest):
            self._valid.discard(inside)
            self._absent.difference_update(entry.blob for entry in (found.files if found else ()))

    def note_lost(self, digests: Iterable[str]) -> None:
        """Record that a worker cannot read artifacts: the remote store lacks their files, too."""
        for digest in digests:
            found = self.find(digest)
            self._absent.update(entry.blob for entry in (found.files if found else ()))
            self._valid.discard(digest)

    def renew(self) -> None:
        """Check the files of every artifact again: another process may have changed them."""
        self._valid.clear()

    def save(self) -> None:
        """Write new entries about files."""
        self.memo.save()
        self._verified_blobs.save()
        self.clean()

    def clean(self) -> None:
        """Remove the folder in which this process has saved values."""
        shutil.rmtree(self._folder, ignore_errors=True)
        self._folder_is_clean = False

    def present(self, entry: Entry) -> bool:
        """Return True when a file exists with the right size; its bytes are not read."""
        try:
            if entry.path:
                return stamp(Path(entry.path)) == entry.stamp
            return os.stat(self._place(entry.blob)).st_size == entry.size
        except FileNotFoundError:
            return False

    def quarantine(self, blob: str) -> None:
        """Move a damaged blob to damaged/, for inspection."""
        (self.root / "damaged").mkdir(exist_ok=True)
        os.replace(self._place(blob), self.root / "damaged" / blob)

    def was_damaged(self, blob: str) -> bool:
        """Return True when a blob of this name was moved to damaged/ before."""
        return (self.root / "damaged" / blob).exists()

    def path(self, room: str, digest: str) -> Path:
        """Path of a blob of this digest."""
        return Path(f"{self.root}/{room}/{digest[:2]}/{digest[2:]}")

    def _place(self, blob: str) -> str:
        return f"{self._blobs}/{blob[:2]}/{blob[2:]}"


def is_store(root: Path) -> bool:
    """Return True for a folder that was prepared as a store; nothing is written."""
    return all(os.path.isdir(root / name) for name in ("blobs", "traces"))


def prepare_store(root: Path) -> None:
    """Create the folders; StoreError when they cannot be written to, or hold a store of a previous format."""
    if root.is_dir():
        _check_format(root)
    try:
        for name in FOLDERS:
            os.makedirs(root / name, exist_ok=True)
        if not read_cache(root / "format"):
            write_cache(root / "format", {"format": FORMAT})
        probe = root / "scratch" / unique("probe")
        probe.write_bytes(b"?")
        probe.unlink()
    except OSError as error:
        raise StoreError(error.errno, f"the store {root} cannot be written to ({explain_os(error)}); free some space, fix its "
                                      "permissions, or choose another folder for the store") from error


def _check_format(root: Path) -> None:
    """Raise StoreError for a store of another format, whose traces this version does not read."""
    found = read_cache(root / "format").get("format", "a previous one" if (root / "manifests").is_dir() else FORMAT)
    if found != FORMAT:
        raise StoreError(errno.EINVAL, f"the store {root} has another format (expected {FORMAT}, got {found}); delete it, or "
                                       "choose another folder for the store")


def explain_os(error: OSError) -> str:
    """Describe an operating-system error."""
    words = {errno.ENOSPC: "no space left on the disk", errno.EDQUOT: "the disk quota is used up",
             errno.EROFS: "the file system is read-only", errno.EACCES: "permission denied"}
    return words.get(error.errno or 0, str(error))


def _digest_of(path: str) -> tuple[str, int]:
    """(digest, size in bytes) of a file, read once."""
    file = os.open(path, os.O_RDONLY)
    try:
        hasher, size = blake3(), 0
        block = min(os.fstat(file).st_size + 1, CHUNK_BYTES)
        while chunk := os.read(file, block):
            hasher.update(chunk)
            size += len(chunk)
    finally:
        os.close(file)
    return hasher.hexdigest(), size


def _files_in(folder: str, prefix: str = "") -> list[tuple[str, str, bool]]:
    """(name relative to the folder, path, is a link) of every file and link, sorted by name."""
    found: list[tuple[str, str, bool]] = []
    with os.scandir(folder) as items:
        for item in items:
            if item.is_symlink():
                found.append((prefix + item.name, item.path, True))
            elif item.is_dir():
                found += _files_in(item.path, f"{prefix}{item.name}/")
            elif item.is_file():
                found.append((prefix + item.name, item.path, False))
    found.sort()
    return found

