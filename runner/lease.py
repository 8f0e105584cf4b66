"""Leases by advisory kernel locks: on a file, for a whole store, and on one byte of a file, for a key.

The kernel releases a lock when its owner dies, so there is no unlock command and no process id is trusted.
"""

from __future__ import annotations

import errno
import fcntl
import os
import struct
from pathlib import Path

KEYS = "keys.lock"
"""file of which each key locks one byte; it stays empty"""
DIGITS = 15
"""hexadecimal digits of a key that choose its byte: 60 bits, so that two keys never meet in practice"""
_OWNED = hasattr(fcntl, "F_OFD_SETLK")
"""locks that belong to an open file, not to a process; Linux has them"""
_FLOCK = "hhqqi"


class Lease:
    """Attempt to lock a file.

    `held` is true if it succeeded; `release`, or the end of the process, unlocks.
    """

    def __init__(self, path: Path, shared: bool = False) -> None:
        self._path = path
        self._file = self._acquire(fcntl.LOCK_SH if shared else fcntl.LOCK_EX)

    @property
    def held(self) -> bool:
        """True while this process owns the lease."""
        return self._file is not None

    def release(self, remove: bool = True) -> None:
        """Release the lease; the file is removed first, while it is still locked."""
        if self._file is not None:
            if remove:
                self._path.unlink(missing_ok=True)
            os.close(self._file)
            self._file = None

    def _acquire(self, how: int) -> int | None:
        self._path.parent.mkdir(parents=True, exist_ok=True)
        while True:
            file = os.open(self._path, os.O_RDWR | os.O_CREAT, 0o644)
            try:
                fcntl.flock(file, how | fcntl.LOCK_NB)
            except BlockingIOError:
                os.close(file)
                return None
            if self._is_still(file):
                return file
            os.close(file)  # the last owner removed the file between open and lock: retry with the new file

    def _is_still(self, file: int) -> bool:
        try:
            return os.stat(self._path).st_ino == os.fstat(file).st_ino
        except FileNotFoundError:
            return False


class KeyLeases:
    """Leases on keys of one store, each a lock on one byte of leases/keys.lock."""

    def __init__(self, root: Path) -> None:
        self._path = root / "leases" / KEYS
        self._file: int | None = None
        self._owner = 0

    def acquire(self, key: str) -> bool:
        """Lock a key; False when another process, or another holder in this one, has it."""
        return self._lock(key, fcntl.F_WRLCK)

    def release(self, key: str) -> None:
        """Unlock a key."""
        self._lock(key, fcntl.F_UNLCK)

    def is_free(self, key: str) -> bool:
        """Return True when no process holds the key; it is not locked."""
        if not self.acquire(key):
            return False
        self.release(key)
        return True

    def close(self) -> None:
        """Release all keys."""
        if self._file is not None and self._owner == os.getpid():
            os.close(self._file)
        self._file = None

    def _lock(self, key: str, how: int) -> bool:
        if self._file is None or self._owner != os.getpid():
            self._file, self._owner = os.open(self._path, os.O_RDWR | os.O_CREAT, 0o644), os.getpid()
        at = int(key[:DIGITS], 16)
        try:
            if _OWNED:
                fcntl.fcntl(self._file, fcntl.F_OFD_SETLK, struct.pack(_FLOCK, how, os.SEEK_SET, at, 1, 0))
            else:
                fcntl.lockf(self._file, (fcntl.LOCK_UN if how == fcntl.F_UNLCK else fcntl.LOCK_EX) | fcntl.LOCK_NB, 1, at)
        except OSError as error:
            if error.errno not in (errno.EACCES, errno.EAGAIN):
                raise
            return False
        return True


def has_writer(path: Path) -> bool:
    """Return True while a process holds the lock of a file that it writes: a segment, the log of a run."""
    try:
        file = os.open(path, os.O_RDONLY)
    except FileNotFoundError:
        return False
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(file)
    return False
