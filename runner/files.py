"""Digests of files outside the store, remembered by size, mtime and inode so that a large video is hashed once.

A folder that is taken as one (frames by the thousand) is remembered by its own stamp: names that come and go are noticed, a
file that is written over in place is not before it is hashed anew (`rehash`).
"""

from __future__ import annotations

import json
import os
import time
from pathlib import Path
from typing import Any

from runner.canonical import digest, path_digest

RACY_NS = 50_000_000  # a file younger than this when it is hashed may change again without a new mtime: not remembered
GLANCE_BYTES = 1 << 26
"""files up to this size are hashed even where a glance is enough"""
Stamp = tuple[int, int, int]


def stamp(path: Path) -> Stamp:
    """(size, mtime ns, inode): what a file's digest is remembered by."""
    found = os.stat(path)
    return found.st_size, found.st_mtime_ns, found.st_ino


class FileMemo:
    """path -> digest of the bytes. `rehash` distrusts what was remembered before this run; with `glance` large files that are not
    remembered get a stand-in, made of their stamp and fit for a plan alone, and are not read."""

    def __init__(self, store: Path, rehash: bool = False, glance: bool = False) -> None:
        self.glance = glance
        self._path = store / ".cache" / "files.json"
        self._known: dict[str, list] = {} if rehash else read_cache(self._path) or {}
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
        if stamp(path) != now:
            raise OSError(f"{path} changed while it was read; run again when it is complete")
        if time.time_ns() - now[1] > RACY_NS:
            self._known[str(path)] = [now, found]
            self._fresh = True
        return found, now[0]

    def save(self) -> None:
        """Write what was learned, at once."""
        if self._fresh:
            write_atomic(self._path, json.dumps(self._known).encode())
            self._fresh = False


def read_cache(path: Path) -> Any:
    """What a cache file holds, or None: one that is missing or torn is made anew from what it was made of."""
    try:
        return json.loads(path.read_bytes())
    except (FileNotFoundError, ValueError):
        return None


def write_atomic(path: Path, data: bytes) -> None:
    """The whole file or the old one, also when killed half-way. Parent folders are made."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        temporary.write_bytes(data)
    except FileNotFoundError:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary.write_bytes(data)
    os.replace(temporary, path)


class SeenBlobs:
    """Blobs whose bytes were hashed, with size and change time at that moment, so that a run that does nothing reads nothing.
    (The change time cannot be set back, as the modification time can.)"""

    def __init__(self, store: Path) -> None:
        self._path = store / ".cache" / "blobs.json"
        self._seen: dict[str, list[int]] = read_cache(self._path) or {}
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
            write_atomic(self._path, json.dumps(self._seen).encode())
            self._fresh = False
