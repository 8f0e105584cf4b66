"""Small files of the store, sealed with a checksum and replaced atomically; remembered digests of files outside it.

A sealed file is a JSON object whose first entry, "check", is the BLAKE3 digest of all following bytes, taken under a tag.
Definitions and all caches are sealed, so that a flipped byte is found on reading.

A folder that is hashed as one (thousands of frames) is remembered by its own stamp. New and removed names are noticed; a file that
is overwritten in place is noticed only when the folder is hashed again (`rehash`).
"""

from __future__ import annotations

import json
import os
import time
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from blake3 import blake3

from runner.canonical import digest, path_digest

RACY_NS = 50_000_000  # a younger file may change again within the same mtime, so its digest is not remembered
PLAN_HASH_BYTES = 1 << 26
"""files up to this size are hashed even for a plan"""
Stamp = tuple[int, int, int, int]
FORMAT = "afford-store-4"
"""part of every checksum, so that files of another version of the store do not fit"""
HEAD = b'{"check":"'
HEX = 64


class Source(NamedTuple):
    """Source file under the root of the code; on another host it has the same content, but another stamp."""

    path: str
    """relative to the root"""
    content: str
    """digest of the bytes"""
    stamp: Stamp


class DamagedError(ValueError):
    """Sealed file whose bytes do not match its checksum."""


def stamp(path: str | Path) -> Stamp:
    """Return (size, mtime ns, inode, ctime ns) of a file, under which its digest is remembered.

    The ctime cannot be set back.
    """
    found = os.stat(path)
    return found.st_size, found.st_mtime_ns, found.st_ino, found.st_ctime_ns


@cache
def host() -> str:
    """Name of this machine, as part of file names."""
    return "".join(letter if letter.isalnum() else "-" for letter in os.uname().nodename)[:40]


def unique(name: str) -> str:
    """Return a hidden temporary name that is unique on all hosts: host, process id, random id."""
    return f".{name}.{host()}-{os.getpid()}-{os.urandom(4).hex()}"


def seal(tree: dict[str, Any], tag: str) -> bytes:
    """Encode a JSON object with its checksum; `tag` names the object, so that no other file is accepted in its place."""
    body = json.dumps(tree, separators=(",", ":")).encode()[1:]
    rest = b'",' + body if tree else b'"' + body
    return HEAD + _checksum(rest, tag) + rest


def unseal(data: bytes, tag: str) -> Any:
    """Decode the result of `seal`; DamagedError when a byte or the tag differs."""
    start = len(HEAD) + HEX
    if data[:start] != HEAD + _checksum(memoryview(data)[start:], tag):
        raise DamagedError(f"{tag}: {len(data)} bytes do not match their checksum")
    tree = json.loads(data)
    del tree["check"]
    return tree


def _checksum(rest: bytes | memoryview, tag: str) -> bytes:
    return blake3(f"afford-seal {tag}\0".encode()).update(rest).hexdigest().encode()


class FileMemo:
    """Remembers the digest of each file outside the store.

    `rehash` ignores what earlier runs remembered. With `plan_only`, a large file that is not remembered is not read. Its digest
    is a stand-in made of its stamp, which is valid for a plan alone.
    """

    def __init__(self, store: Path, rehash: bool = False, plan_only: bool = False) -> None:
        self.plan_only = plan_only
        self._path = store / ".cache" / "files.json"
        self._known: dict[str, list] = {} if rehash else read_cache(self._path)
        self._fresh = False

    def knows(self, path: Path) -> bool:
        """Return True when the digest is remembered; OSError when there is no such file."""
        known = self._known.get(str(path))
        return known is not None and tuple(known[0]) == stamp(path)

    def digest(self, path: Path) -> tuple[str, int]:
        """(digest, size in bytes) of a file; OSError when it cannot be read."""
        now = stamp(path)
        known = self._known.get(str(path))
        if known and tuple(known[0]) == now:
            return known[1], now[0]
        if self.plan_only and (now[0] > PLAN_HASH_BYTES or path.is_dir()):
            return digest("afford-unread", [str(path), *now]), now[0]
        found = path_digest(path)
        if stamp(path)[:3] != now[:3]:  # a new hard link changes only the ctime
            raise OSError(f"{path} changed while it was read; run again when it is complete")
        if time.time_ns() - now[3] > RACY_NS:
            self._known[str(path)] = [now, found]
            self._fresh = True
        return found, now[0]

    def save(self) -> None:
        """Write the new digests."""
        if self._fresh:
            write_cache(self._path, self._known)
            self._fresh = False


def read_cache(path: Path) -> dict[str, Any]:
    """Read a cache file; a missing or damaged one counts as empty and is rebuilt."""
    try:
        return dict(unseal(path.read_bytes(), f"cache {path.name}"))
    except (FileNotFoundError, DamagedError):
        return {}


def write_cache(path: Path, tree: dict[str, Any]) -> None:
    """Replace a cache file."""
    write_atomic(path, seal(tree, f"cache {path.name}"))


def write_atomic(path: Path, data: bytes) -> None:
    """Replace a file atomically, also when the process is killed; parent folders are created."""
    temporary = path.with_name(unique(path.name))
    try:
        temporary.write_bytes(data)
    except FileNotFoundError:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary.write_bytes(data)
    os.replace(temporary, path)


class VerifiedBlobs:
    """Size and change time of blobs at the moment their bytes were hashed, where they differ from those in the manifest.

    These are blobs of a copied store, and blobs that were written again. The change time, unlike the modification time, cannot be
    set back.
    """

    def __init__(self, store: Path) -> None:
        self._path = store / ".cache" / "blobs.json"
        self._seen: dict[str, list[int]] = read_cache(self._path)
        self._fresh = False

    def same(self, blob: str, found: os.stat_result) -> bool:
        """Return True when the file has not changed since it was hashed here."""
        return self._seen.get(blob) == [found.st_size, found.st_ctime_ns]

    def note(self, blob: str, path: str) -> None:
        """Record that the bytes of this file match its name."""
        found = os.stat(path)
        self._seen[blob] = [found.st_size, found.st_ctime_ns]
        self._fresh = True

    def save(self) -> None:
        """Write the new entries."""
        if self._fresh:
            write_cache(self._path, self._seen)
            self._fresh = False
