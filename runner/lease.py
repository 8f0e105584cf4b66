"""One run per key: an advisory lock on a file, held by the process that runs the task.

The kernel drops the lock when its owner dies, however it dies, so no unlock command exists and no process id is ever trusted.
"""

from __future__ import annotations

import fcntl
import os
from pathlib import Path


class Lease:
    """Try to own a key. `held` tells whether it worked; `release` (or the end of the process) gives it back."""

    def __init__(self, path: Path, shared: bool = False) -> None:
        self._path = path
        self._file = self._acquire(fcntl.LOCK_SH if shared else fcntl.LOCK_EX)

    @property
    def held(self) -> bool:
        """True while this process owns the key."""
        return self._file is not None

    def release(self, remove: bool = True) -> None:
        """Give the key back; the file goes first, while it is still ours."""
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
            os.close(file)  # its last owner removed it between our open and our lock: take the new one

    def _is_still(self, file: int) -> bool:
        try:
            return os.stat(self._path).st_ino == os.fstat(file).st_ino
        except FileNotFoundError:
            return False
