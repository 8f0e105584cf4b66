"""Lease on a key: an advisory lock on a file, held by the process that runs the task.

The kernel releases the lock when the owner dies, so there is no unlock command and no process id is trusted.
"""

from __future__ import annotations

import fcntl
import os
from pathlib import Path


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
