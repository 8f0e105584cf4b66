"""Pickled messages over a stream socket, between the scheduler and a worker.

A worker waits for its messages. The scheduler never waits for a worker, which may hang at any byte: what the socket does not take
is sent later, and messages are complete before they are read. Only processes of the same run send to each other.
"""

from __future__ import annotations

import os
import pickle
from typing import Any

HEAD = 8
"""bytes before every message: its length"""
AT_ONCE = 1 << 20
"""bytes of one read"""
MAX_READS = 64
"""reads in a row from one worker, so that one that reports without pause does not keep the scheduler"""


class Channel:
    """One end of a connection; `blocking` for a worker."""

    def __init__(self, fd: int, blocking: bool = True) -> None:
        self._fd, self._incoming, self._outgoing = fd, bytearray(), bytearray()
        self.ended = False
        """True when the other side has closed the connection"""
        os.set_blocking(fd, blocking)

    def fileno(self) -> int:
        """File descriptor, for poll."""
        return self._fd

    def close(self) -> None:
        """Close this end."""
        os.close(self._fd)

    # -- of a worker -----------------------------------------------------------------------------------------------

    def send(self, message: Any) -> None:
        """Send a message, and wait until the socket has taken it."""
        self._outgoing += _encoded(message)
        while self._outgoing:
            del self._outgoing[: os.write(self._fd, self._outgoing)]

    def receive(self) -> Any:
        """Wait for a message. EOFError when the other side has closed the connection."""
        while (message := self._complete()) is None:
            try:
                data = os.read(self._fd, AT_ONCE)
            except ConnectionResetError:  # closed before it has read the last message
                data = b""
            if not data:
                raise EOFError("the connection is closed")
            self._incoming += data
        return pickle.loads(message)

    # -- of the scheduler ------------------------------------------------------------------------------------------

    @property
    def pending(self) -> bool:
        """True while a message is not sent completely."""
        return bool(self._outgoing)

    def post(self, message: Any) -> None:
        """Send as much as the socket takes; `push` sends the rest."""
        self._outgoing += _encoded(message)
        self.push()

    def push(self) -> None:
        """Send more of the posted messages; none to a side that is gone."""
        try:
            while self._outgoing:
                del self._outgoing[: os.write(self._fd, self._outgoing)]
        except BlockingIOError:
            return
        except (BrokenPipeError, ConnectionResetError):
            self._outgoing.clear()  # the end of the worker is noticed where messages are read

    def arrived(self) -> list[Any]:
        """Messages that are complete; sets `ended` when there will be no more."""
        for _ in range(MAX_READS):
            try:
                data = os.read(self._fd, AT_ONCE)
            except BlockingIOError:
                break
            except ConnectionResetError:
                data = b""
            if not data:
                self.ended = True
                break
            self._incoming += data
        found = []
        while (message := self._complete()) is not None:
            found.append(pickle.loads(message))
        return found

    def _complete(self) -> bytes | None:
        """Remove the first message from what has arrived; None while it is incomplete."""
        if len(self._incoming) < HEAD:
            return None
        end = HEAD + int.from_bytes(self._incoming[:HEAD], "little")
        if len(self._incoming) < end:
            return None
        message = bytes(self._incoming[HEAD:end])
        del self._incoming[:end]
        return message


def _encoded(message: Any) -> bytes:
    data = pickle.dumps(message, protocol=pickle.HIGHEST_PROTOCOL)
    return len(data).to_bytes(HEAD, "little") + data
