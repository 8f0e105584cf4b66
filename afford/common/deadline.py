"""Read from a socket until a deadline; a socket's own time-out restarts with every byte."""

from __future__ import annotations

import io
import socket
import time
from typing import Any


def seconds_left(ends: float) -> float:
    """Return the seconds until `ends`, a value of `time.monotonic`; TimeoutError when the deadline has passed."""
    left = ends - time.monotonic()
    if left <= 0:
        raise TimeoutError("timed out")
    return left


class DeadlineStream(io.RawIOBase):
    """Raw stream of a socket that raises TimeoutError when a read is not complete at `ends` (`time.monotonic`)."""

    def __init__(self, sock: socket.socket, raw: io.RawIOBase, ends: float) -> None:
        """Wrap `raw`, the unbuffered stream of `sock`; closing this stream closes `raw`."""
        self._sock, self._raw, self.ends = sock, raw, ends

    def readable(self) -> bool:
        """Return True."""
        return True

    def readinto(self, buffer: Any) -> int | None:
        """Receive bytes into the buffer; return their number, 0 at the end of the stream."""
        self._sock.settimeout(seconds_left(self.ends))
        return self._raw.readinto(buffer)

    def close(self) -> None:
        """Close the stream."""
        self._raw.close()
        super().close()
