"""Reading from a socket until a deadline, however slowly its bytes come: a socket's own time-out starts anew with every byte."""

from __future__ import annotations

import io
import socket
import time
from typing import Any


def seconds_left(ends: float) -> float:
    """Seconds until `ends`, a value of `time.monotonic`. TimeoutError when there are none."""
    left = ends - time.monotonic()
    if left <= 0:
        raise TimeoutError("timed out")
    return left


class DeadlineStream(io.RawIOBase):
    """Raw stream of a socket: a read that has not ended at `ends`, a value of `time.monotonic`, raises TimeoutError."""

    def __init__(self, sock: socket.socket, raw: io.RawIOBase, ends: float) -> None:
        """`raw`: stream of `sock` without a buffer, which is closed with this one."""
        self._sock, self._raw, self.ends = sock, raw, ends

    def readable(self) -> bool:
        """True."""
        return True

    def readinto(self, buffer: Any) -> int | None:
        """Number of bytes received into the buffer, 0 at the end of the stream."""
        self._sock.settimeout(seconds_left(self.ends))
        return self._raw.readinto(buffer)

    def close(self) -> None:
        """Close the stream."""
        self._raw.close()
        super().close()
