"""Small files of the store, sealed with a checksum and replaced whole; digests of files outside it, remembered by their stamps.

A sealed file is a JSON object whose first entry, "check", is the BLAKE3 of all bytes that follow it, taken under a tag. Traces,
manifests, definitions, failures and every cache are sealed: one flipped byte is found when the file is read.

A folder that is hashed as one (frames by the thousand) is remembered by its own stamp: names that come and go are noticed, a
file that is written over in place is not before it is hashed anew (`rehash`).
"""

from __future__ import annotations

import json
import os
import socket
import time
import uuid
from functools import cache
from pathlib import Path
from typing import Any

from blake3 import blake3

from runner.canonical import digest, path_digest

RACY_NS = 50_000_000  # a file younger than this when it is hashed may change again without a new mtime: not remembered
GLANCE_BYTES = 1 << 26
"""files up to this size are hashed even where a glance is enough"""
Stamp = tuple[int, int, int, int]
FORMAT, FORMER = "afford-store-3", ("afford-store-2",)
"""part of every checksum, so that files of another version of the store do not fit"""
HEAD = b'{"check":"'
HEX = 64


class DamagedError(ValueError):
    """A sealed file whose bytes do not fit its checksum."""


def stamp(path: str | Path) -> Stamp:
    """Return (size, mtime ns, inode, ctime ns): what a file's digest is remembered by. (The ctime cannot be set back.)"""
    found = os.stat(path)
    return found.st_size, found.st_mtime_ns, found.st_ino, found.st_ctime_ns


@cache
def host() -> str:
    """Name of this machine, as part of file names."""
    return "".join(letter if letter.isalnum() else "-" for letter in socket.gethostname())[:40]


def unique(name: str) -> str:
    """Return a hidden name for a temporary `name`, free on every host that shares the folder: host, process id, random id."""
    return f".{name}.{host()}-{os.getpid()}-{uuid.uuid4().hex[:8]}"


def seal(tree: dict[str, Any], tag: str) -> bytes:
    """Encode a JSON object with its checksum; `tag` says what the object is, so that no other file fits in its place."""
    body = json.dumps(tree, separators=(",", ":")).encode()[1:]
    rest = b'",' + body if tree else b'"' + body
    return HEAD + _checksum(rest, tag, FORMAT) + rest


def unseal(data: bytes, tag: str) -> Any:
    """Decode what `seal` encoded; DamagedError when a byte, or the tag, is another."""
    start = len(HEAD) + HEX
    rest = data[start:]
    if data[:start] != HEAD + _checksum(rest, tag, FORMAT):
        raise DamagedError(f"expected a sealed {tag}, got {len(data)} bytes that do not fit their checksum")
    return json.loads(b"{" + rest.removeprefix(b'"').removeprefix(b","))


def format_of(data: bytes, tag: str) -> str | None:
    """The format, present or former, that sealed bytes are of; None when they fit none."""
    start = len(HEAD) + HEX
    fits = (form for form in (FORMAT, *FORMER) if data[:start] == HEAD + _checksum(data[start:], tag, form))
    return next(fits, None)


def _checksum(rest: bytes, tag: str, form: str) -> bytes:
    return blake3(f"{form} {tag}\0".encode() + rest).hexdigest().encode()


class FileMemo:
    """path -> digest of the bytes. `rehash` distrusts what was remembered before this run; with `glance` large files that are not
    remembered get a stand-in, made of their stamp and fit for a plan alone, and are not read.
    """

    def __init__(self, store: Path, rehash: bool = False, glance: bool = False) -> None:
        self.glance = glance
        self._path = store / ".cache" / "files.json"
        self._known: dict[str, list] = {} if rehash else read_cache(self._path)
        self._fresh = False

    def knows(self, path: Path) -> bool:
        """Whether the digest is remembered; OSError when there is no such file."""
        known = self._known.get(str(path))
        return known is not None and tuple(known[0]) == stamp(path)

    def digest(self, path: Path) -> tuple[str, int]:
        """(digest, size in bytes); OSError when the file cannot be read."""
        now = stamp(path)
        known = self._known.get(str(path))
        if known and tuple(known[0]) == now:
            return known[1], now[0]
        if self.glance and (now[0] > GLANCE_BYTES or path.is_dir()):
            return digest("afford-unread", [str(path), *now]), now[0]
        found = path_digest(path)
        if stamp(path)[:3] != now[:3]:  # a link to the file changes its ctime alone
            raise OSError(f"{path} changed while it was read; run again when it is complete")
        if time.time_ns() - now[3] > RACY_NS:
            self._known[str(path)] = [now, found]
            self._fresh = True
        return found, now[0]

    def save(self) -> None:
        """Write what was learned, at once."""
        if self._fresh:
            write_cache(self._path, self._known)
            self._fresh = False


def read_cache(path: Path) -> dict[str, Any]:
    """Read a cache file. One that is missing or damaged counts as empty: it is made anew from what it was made of."""
    try:
        return dict(unseal(path.read_bytes(), f"cache {path.name}"))
    except (FileNotFoundError, DamagedError):
        return {}


def write_cache(path: Path, tree: dict[str, Any]) -> None:
    """Replace a cache file."""
    write_atomic(path, seal(tree, f"cache {path.name}"))


def write_atomic(path: Path, data: bytes) -> None:
    """Replace a file: the whole new one or the old one is there, also when the process is killed. Parent folders are made."""
    temporary = path.with_name(unique(path.name))
    try:
        temporary.write_bytes(data)
    except FileNotFoundError:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary.write_bytes(data)
    os.replace(temporary, path)


class SeenBlobs:
    """Blobs whose bytes were hashed, with size and change time at that moment, so that a run that does nothing reads nothing.
    (The change time cannot be set back, as the modification time can.)
    """

    def __init__(self, store: Path) -> None:
        self._path = store / ".cache" / "blobs.json"
        self._seen: dict[str, list[int]] = read_cache(self._path)
        self._fresh = False

    def same(self, blob: str, path: str) -> bool:
        """Whether the file is as it was when it was hashed; FileNotFoundError when it is gone."""
        found = os.stat(path)
        return self._seen.get(blob) == [found.st_size, found.st_ctime_ns]

    def note(self, blob: str, path: str) -> None:
        """The bytes of this file fit its name."""
        found = os.stat(path)
        self._seen[blob] = [found.st_size, found.st_ctime_ns]
        self._fresh = True

    def save(self) -> None:
        """Write what was seen, at once."""
        if self._fresh:
            write_cache(self._path, self._seen)
            self._fresh = False
