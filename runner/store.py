"""Content-addressed store of blobs, and of manifests that list the blobs of each typed value.

    blobs/ab/cdef...        bytes named by their BLAKE3 digest, read-only, put in place by rename
    manifests/ab/cdef.json  kind and files of a plain artifact, or kind and children of a composite one (tuple, bundle)
    damaged/                blobs whose bytes do not match their name

An artifact is named by the digest of its logical content. Early cut-off therefore works per element and per field of a composite,
independent of the codec's file layout. Files of leaf values are never copied: their manifest refers to them. Every file is hashed
before it is read; a blob that does not match is moved aside, and `LostError` is raised. Manifests are sealed (`runner.files`). A
cached manifest is valid while its file is unchanged, and restores a file that was damaged or deleted.
"""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from runner.canonical import digest as tagged
from runner.canonical import file_digest
from runner.codec import Codec
from runner.files import DamagedError, FileMemo, VerifiedBlobs, read_cache, seal, stamp, unique, unseal, write_atomic, write_cache

FOLDERS = ("blobs", "manifests", "traces", "leases", "failures", "scratch", "damaged", ".cache")


class StoreError(OSError):
    """The store cannot be used; the message says what to do."""


class LostError(Exception):
    """An artifact cannot be read; `damaged` distinguishes a broken blob from a missing one."""

    def __init__(self, digest: str, damaged: bool, what: str) -> None:
        super().__init__(digest, damaged, what)
        self.digest, self.damaged, self.what = digest, damaged, what

    def __str__(self) -> str:
        return f"artifact {self.digest[:12]} is {'damaged' if self.damaged else 'missing'}: {self.what}"


@dataclass(frozen=True)
class Entry:
    """One file of an artifact.

    `path` is '' for a blob. A leaf's file has its path, and its stamp at the time of hashing.
    """

    name: str
    blob: str
    size: int
    path: str = ""
    stamp: tuple[int, int, int, int] | None = None


@dataclass(frozen=True)
class Manifest:
    """Files of a plain artifact, or children of a composite one."""

    kind: str
    files: tuple[Entry, ...] = ()
    children: tuple[tuple[str, str], ...] | None = None


class Store:
    """Blobs and manifests under one folder."""

    def __init__(self, root: Path, codec: Codec, rehash: bool = False, plan_only: bool = False) -> None:
        self.root, self.codec = root, codec
        self.memo = FileMemo(root, rehash, plan_only)
        self._manifests: dict[str, Manifest] = {}
        self._verified_blobs = VerifiedBlobs(root)
        self._recent: dict[str, object] = {}
        self._folder_is_clean = False
        self._cache = root / ".cache" / "manifests.json"
        self._trees: dict[str, list[Any]] = read_cache(self._cache)
        """digest -> size and change time of the manifest's file when it was read, and its content"""
        self._fresh = False
        self._folder = root / "scratch" / unique("save")[1:]

    # -- writing ---------------------------------------------------------------------------------------------------

    def put(self, value: object, scratch: Path) -> str:
        """Store the output of a stage.

        Files in the stage's private folder `scratch` are moved, not copied. A file may occur in several parts of the
        output.
        """
        return self._put(value, scratch, {})

    def _put(self, value: object, scratch: Path, moved: dict[Path, tuple[str, int]]) -> str:
        parts = self.codec.children(value)
        if parts is not None:
            return self._put_composite(self.codec.kind(value), [(name, self._put(part, scratch, moved)) for name, part in parts])
        with self._saved(value) as files:
            entries = tuple(self._take(path, name, scratch, moved) for name, path in files)
        return self._put_manifest(self.codec.digest(value), Manifest(self.codec.kind(value), entries))

    def put_leaf(self, value: object) -> str:
        """Store a value from outside.

        Files that the codec writes become blobs; linked files stay where they are.
        """
        parts = self.codec.children(value)
        if parts is not None:
            return self._put_composite(self.codec.kind(value), [(name, self.put_leaf(part)) for name, part in parts])
        digest = self.codec.digest(value)
        known = self.find(digest)
        if known is not None and all(self._entry_state(entry) == "ok" for entry in known.files):
            return digest
        if self.memo.plan_only:
            return self._put_manifest(digest, Manifest(self.codec.kind(value)))
        with self._saved(value) as files:
            entries = tuple(self._refer(path, name) if path.is_symlink() else self._take(path, name, path.parent, {})
                            for name, path in files)
        before = {entry.name: entry.blob for entry in known.files} if known else {}
        for entry in entries:
            if entry.path and before.get(entry.name, entry.blob) != entry.blob:
                raise StoreError(errno.ESTALE, f"{entry.path} changed since its digest was computed; run again")
        return self._put_manifest(digest, Manifest(self.codec.kind(value), entries))

    def put_tuple(self, children: list[tuple[str, str]]) -> str:
        """Store a composite of stored artifacts."""
        return self._put_composite("tuple", children)

    def _put_composite(self, kind: str, children: list[tuple[str, str]]) -> str:
        names = [name for name, _ in children]
        if len(set(names)) != len(names):
            twice = sorted({name for name in names if names.count(name) > 1})
            raise ValueError(f"elements of a {kind} must have different names, got {twice[0]!r} more than once")
        digest = tagged("afford-composite", [kind, [list(child) for child in children]])
        return digest if self.find(digest) else self._put_manifest(digest, Manifest(kind, children=tuple(children)))

    def _put_manifest(self, digest: str, manifest: Manifest) -> str:
        if self.memo.plan_only:  # a plan writes nothing: digests of files that it has not read are stand-ins
            self._manifests[digest] = manifest
            return digest
        tree = {"kind": manifest.kind, "files": [[e.name, e.blob, e.size, e.path, e.stamp] for e in manifest.files],
                "children": manifest.children}
        self._write_tree(digest, tree)
        self._trees.pop(digest, None)
        self._manifests[digest] = manifest
        return digest

    def _write_tree(self, digest: str, tree: dict[str, Any]) -> None:
        write_atomic(self.path("manifests", digest, ".json"), seal(tree, f"manifest {digest}"))

    @contextmanager
    def _saved(self, value: object) -> Iterator[list[tuple[str, Path]]]:
        """Save a value with the codec; yield its files as (name, path).

        The folder belongs to this process and is reused, since creating and removing one costs more than the rest.
        """
        folder = self._folder
        if not self._folder_is_clean:
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
        self._folder_is_clean = False
        self.codec.save(value, folder)
        yield _files_in(folder)
        remaining = list(folder.iterdir())
        for path in remaining:
            if path.is_symlink():
                path.unlink()
        self._folder_is_clean = all(path.is_symlink() for path in remaining)

    def _take(self, path: Path, name: str, scratch: Path, moved: dict[Path, tuple[str, int]]) -> Entry:
        """Turn a file into a blob.

        A file is moved when the codec has written it or when it is in the task's own scratch folder, else copied.
        """
        linked = path.is_symlink()
        source = original = path.resolve() if linked else path
        if linked and source in moved:
            blob, size = moved[source]
            return Entry(name, blob, size)
        if linked and not source.is_relative_to(scratch.resolve()):
            held = self._held(source)
            if held is not None:
                return Entry(name, held, source.stat().st_size)
            path.unlink()
            source = Path(shutil.copyfile(source, path))
        blob, size = file_digest(source), source.stat().st_size
        if linked:
            moved[original] = blob, size
        place = self.path("blobs", blob)
        source.chmod(0o444)
        place.parent.mkdir(exist_ok=True)
        os.replace(source, place)
        return Entry(name, blob, size)

    def _held(self, source: Path) -> str | None:
        """Digest of a file that is a blob of this store and matches its name."""
        blobs = (self.root / "blobs").resolve()
        if not source.is_relative_to(blobs):
            return None
        named = "".join(source.relative_to(blobs).parts)
        return named if file_digest(source) == named else None

    def _refer(self, path: Path, name: str) -> Entry:
        target = path.resolve()
        blob, size = self.memo.digest(target)
        return Entry(name, blob, size, str(target), stamp(target))

    # -- reading ---------------------------------------------------------------------------------------------------

    def find(self, digest: str) -> Manifest | None:
        """Manifest of an artifact; None when it is missing or damaged."""
        if digest not in self._manifests:
            tree = self._tree(digest)
            if tree is None:
                return None
            files = tuple(Entry(n, b, s, p, tuple(t) if t else None) for n, b, s, p, t in tree["files"])
            children = tree["children"]
            self._manifests[digest] = Manifest(
                tree["kind"], files, None if children is None else tuple((n, d) for n, d in children))
        return self._manifests[digest]

    def _tree(self, digest: str) -> dict[str, Any] | None:
        """Content of a manifest: from the cache while its file is unchanged, else from the file.

        A damaged file is rewritten from the cache.
        """
        path, known = self.path("manifests", digest, ".json"), self._trees.get(digest)
        tree = None
        with suppress(FileNotFoundError, DamagedError):
            found = os.stat(path)
            if known and known[:2] == [found.st_size, found.st_ctime_ns]:
                return dict(known[2])
            tree = unseal(path.read_bytes(), f"manifest {digest}")
        if tree is None:
            if known is None:
                return None
            tree = dict(known[2])
            if self.memo.plan_only:
                return tree
            self._write_tree(digest, tree)
        found = os.stat(path)
        self._trees[digest], self._fresh = [found.st_size, found.st_ctime_ns, tree], True
        return tree

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

    def kinds(self, digest: str) -> set[str]:
        """Schemas that occur in an artifact."""
        return {found.kind for _, found in self.closure(digest) if found}

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
        return self.codec.load(found.kind, self.files(digest))

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
        path = self.path("blobs", entry.blob)
        try:
            if file_digest(path) == entry.blob:
                return path
        except FileNotFoundError:
            self.forget(digest)
            raise LostError(digest, self.was_damaged(entry.blob), f"{entry.name} is not in the store") from None
        self.quarantine(entry.blob)
        self.forget(digest)
        raise LostError(digest, True, f"{entry.name} did not match its digest and was moved to damaged/")

    def _verified_leaf(self, digest: str, entry: Entry) -> Path:
        path = Path(entry.path)
        try:
            if stamp(path) == entry.stamp or self.memo.digest(path)[0] == entry.blob:
                return path
        except FileNotFoundError:
            raise LostError(digest, False, f"{path} is gone") from None
        raise LostError(digest, True, f"{path} changed after the run began")

    def state(self, digest: str) -> str:
        """'ok', 'lost' or 'damaged': state of the files of an artifact.

        Bytes are read again only where a file's size or change time differs. A damaged blob is moved aside.
        """
        worst = "ok"
        for _, found in self.closure(digest):
            if found is None:
                return "lost"
            for entry in found.files:
                state = self._entry_state(entry)
                worst = state if state != "ok" else worst
        if worst != "ok":
            self.forget(digest)
        return worst

    def _entry_state(self, entry: Entry) -> str:
        if entry.path:
            return "ok" if self.present(entry) else "lost"
        path = f"{self.root}/blobs/{entry.blob[:2]}/{entry.blob[2:]}"
        try:
            if self._verified_blobs.same(entry.blob, path):
                return "ok"
            if file_digest(Path(path)) == entry.blob:
                self._verified_blobs.note(entry.blob, path)
                return "ok"
        except FileNotFoundError:
            return "damaged" if self.was_damaged(entry.blob) else "lost"
        self.quarantine(entry.blob)
        return "damaged"

    def note(self, digest: str) -> None:
        """Record that a worker has just written and hashed the artifact."""
        self.forget(digest)
        for _, found in self.closure(digest):
            for entry in found.files if found else ():
                self._verified_blobs.note(entry.blob, f"{self.root}/blobs/{entry.blob[:2]}/{entry.blob[2:]}")

    def forget(self, digest: str) -> None:
        """Read the artifact's manifests from disk next time: another process may have replaced them."""
        for inside, _ in list(self.closure(digest)):
            self._manifests.pop(inside, None)
            self._trees.pop(inside, None)

    def renew(self) -> None:
        """Check the file of every manifest again: another process may have changed it."""
        self._manifests.clear()

    def distrust(self) -> None:
        """Read every manifest from its file without repair, so that damage shows."""
        self._manifests.clear()
        self._trees.clear()

    def forget_all(self) -> None:
        """Read every manifest from disk next time."""
        self._manifests.clear()
        self._trees.clear()
        self._fresh = True

    def save(self) -> None:
        """Write new entries about files and manifests."""
        self.memo.save()
        self._verified_blobs.save()
        if self._fresh:
            write_cache(self._cache, self._trees)
            self._fresh = False
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
            return os.stat(self.path("blobs", entry.blob)).st_size == entry.size
        except FileNotFoundError:
            return False

    def quarantine(self, blob: str) -> None:
        """Move a damaged blob to damaged/, for inspection."""
        (self.root / "damaged").mkdir(exist_ok=True)
        os.replace(self.path("blobs", blob), self.root / "damaged" / blob)

    def was_damaged(self, blob: str) -> bool:
        """Return True when a blob of this name was moved to damaged/ before."""
        return (self.root / "damaged" / blob).exists()

    def path(self, room: str, digest: str, suffix: str = "") -> Path:
        """Path of a blob, manifest or trace of this digest."""
        return Path(f"{self.root}/{room}/{digest[:2]}/{digest[2:]}{suffix}")


def is_store(root: Path) -> bool:
    """Return True for a folder that was prepared as a store; nothing is written."""
    return all(os.path.isdir(root / name) for name in ("blobs", "manifests", "traces"))


def prepare_store(root: Path) -> None:
    """Create the folders; StoreError when they cannot be written to."""
    try:
        for name in FOLDERS:
            (root / name).mkdir(parents=True, exist_ok=True)
        probe = root / "scratch" / unique("probe")
        probe.write_bytes(b"?")
        probe.unlink()
    except OSError as error:
        raise StoreError(error.errno, f"the store {root} cannot be written to ({explain_os(error)}); free some space, fix its "
                                      "permissions, or choose another folder for the store") from error


def explain_os(error: OSError) -> str:
    """Describe an operating-system error."""
    words = {errno.ENOSPC: "no space left on the disk", errno.EDQUOT: "the disk quota is used up",
             errno.EROFS: "the file system is read-only", errno.EACCES: "permission denied"}
    return words.get(error.errno or 0, str(error))


def _files_in(folder: Path) -> list[tuple[str, Path]]:
    """(name relative to the folder, path) of every file and link, sorted."""
    found = (path for path in folder.rglob("*") if path.is_symlink() or path.is_file())
    return sorted((path.relative_to(folder).as_posix(), path) for path in found)
