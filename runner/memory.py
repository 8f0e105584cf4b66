"""Memory of this process: resident size, and the peak of one task."""

from __future__ import annotations

import os
import resource
import sys
from contextlib import suppress

STATM, STATUS, CLEAR = "/proc/self/statm", "/proc/self/status", "/proc/self/clear_refs"
HIGHEST = b"VmHWM:"
UNIT = 2**20 if sys.platform == "darwin" else 2**10
"""ru_maxrss counts bytes on macOS, KiB elsewhere"""


def resident_mib() -> float:
    """Resident memory of this process in MiB; its peak where the system does not report the present size."""
    size = _read(STATM, 128)
    return int(size.split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20 if size else _usage_mib()


class PeakMeter:
    """Peak memory of tasks, one after another in one process.

    The figure is the size of the process before its first task plus the growth during the task. What earlier tasks left behind
    does not count, and a library counts for the first task that loads it. Without Linux's counters, the figure is the growth of
    the peak of the whole process.
    """

    def __init__(self) -> None:
        self._bare = self._before = resident_mib()

    def start(self) -> None:
        """Begin a task."""
        with suppress(OSError):  # a kernel that cannot reset the peak: it then covers earlier tasks as well
            file = os.open(CLEAR, os.O_WRONLY)
            try:
                os.write(file, b"5")
            finally:
                os.close(file)
        self._before = resident_mib()

    def peak_mib(self) -> float:
        """Peak since `start`, MiB."""
        return round(self._bare + max(0.0, _highest_mib() - self._before), 1)


def _highest_mib() -> float:
    """Peak of this program. ru_maxrss would include that of the program before exec."""
    _, found, rest = _read(STATUS, 4096).partition(HIGHEST)
    return int(rest.split(None, 1)[0]) / 2**10 if found else _usage_mib()


def _read(path: str, size: int) -> bytes:
    """Beginning of a file of the system, b'' where it does not exist; this is done for every task."""
    try:
        file = os.open(path, os.O_RDONLY)
    except FileNotFoundError:
        return b""
    try:
        return os.read(file, size)
    finally:
        os.close(file)


def _usage_mib() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / UNIT
