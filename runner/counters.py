"""Counters that a worker shares with the scheduler, and that survive its death by any signal."""

from __future__ import annotations

import mmap
import os
import struct

FORMAT = "=qq"
SIZE = struct.calcsize(FORMAT)


class Counters:
    """Numbers of jobs that a worker has begun and finished, in an unnamed file that both processes map."""

    def __init__(self, fd: int) -> None:
        os.ftruncate(fd, SIZE)
        self._memory = mmap.mmap(fd, SIZE)
        self._begun, self._finished = self.read()

    def begin(self) -> None:
        """Count a job that begins."""
        self._begun += 1
        struct.pack_into(FORMAT, self._memory, 0, self._begun, self._finished)

    def finish(self) -> None:
        """Count its end."""
        self._finished += 1
        struct.pack_into(FORMAT, self._memory, 0, self._begun, self._finished)

    def read(self) -> tuple[int, int]:
        """(jobs begun, jobs finished)."""
        begun, finished = struct.unpack_from(FORMAT, self._memory)
        return begun, finished

    def close(self) -> None:
        """Unmap the file."""
        self._memory.close()
