"""A server that a crowd cannot exhaust: so many connections at once, so many bytes at once, and a sentence for all others."""

from __future__ import annotations

import json
import socket
import sys
import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from http.server import ThreadingHTTPServer
from typing import Any

MAX_CONNECTIONS = 128
DROP_S = 0.5
"""longest wait for the place of a connection that was dropped"""
LINGER_S = 1.0
"""how long a refused connection stays open, so that its visitor gets to read why"""


class FullError(Exception):
    """No room within the time."""


class ByteBudget:
    """Bytes that may be in use at once."""

    def __init__(self, total: int) -> None:
        self._free, self._changed = total, threading.Condition()

    @contextmanager
    def taken(self, count: int, wait_s: float) -> Iterator[None]:
        """`count` of them, as soon as they are free. FullError when they are not within `wait_s`."""
        with self._changed:
            if not self._changed.wait_for(lambda: self._free >= count, wait_s):
                raise FullError
            self._free -= count
        try:
            yield
        finally:
            with self._changed:
                self._free += count
                self._changed.notify_all()


class BoundedServer(ThreadingHTTPServer):
    """A server with at most MAX_CONNECTIONS connections, a thread each. A further one takes the place of the one that has been
    silent for longest, or gets 503 where all are busy. A handler calls `silent` before it waits for a request, `busy` when it has
    one.
    """

    daemon_threads = True
    request_queue_size = 128

    def __init__(self, *args: Any) -> None:
        self._seats = threading.BoundedSemaphore(MAX_CONNECTIONS)
        self._silent: dict[socket.socket, None] = {}
        self._lock = threading.Lock()
        self._refused: deque[tuple[float, socket.socket]] = deque()
        super().__init__(*args)

    def process_request(self, request: Any, client_address: Any) -> None:
        """Serve a connection in a thread of its own, or refuse it where MAX_CONNECTIONS are busy."""
        if not (self._seats.acquire(blocking=False) or (self._drop() and self._seats.acquire(timeout=DROP_S))):
            self._refuse(request)
            return
        self.silent(request)
        try:
            super().process_request(request, client_address)
        except BaseException:  # no thread was started that would
            self._seats.release()
            raise

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Serve a connection to its end."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self.busy(request)
            self._seats.release()

    def silent(self, connection: socket.socket) -> None:
        """Note that a connection waits for a request and may be dropped."""
        with self._lock:
            self._silent[connection] = None

    def busy(self, connection: socket.socket) -> None:
        """Note that a connection has a request, or has ended."""
        with self._lock:
            self._silent.pop(connection, None)

    def _drop(self) -> bool:
        """End the connection that has been silent for longest, if there is one; its thread ends, too."""
        with self._lock:
            oldest = next(iter(self._silent), None)
            if oldest is None:
                return False
            del self._silent[oldest]
            with suppress(OSError):  # its visitor has left
                oldest.shutdown(socket.SHUT_RDWR)
            return True

    def service_actions(self) -> None:
        """Close connections that were refused some time ago, and those of a crowd at once."""
        while self._refused and (self._refused[0][0] < time.monotonic() - LINGER_S or len(self._refused) > MAX_CONNECTIONS):
            self.shutdown_request(self._refused.popleft()[1])

    def server_close(self) -> None:
        """Stop listening."""
        super().server_close()
        for _, connection in self._refused:
            connection.close()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """The traceback of a failure on the terminal; a visitor who left, or does not take the answer, is no failure."""
        if not isinstance(sys.exc_info()[1], ConnectionError | TimeoutError):
            super().handle_error(request, client_address)

    def _refuse(self, connection: socket.socket) -> None:
        """Say in one sentence that there is no place, without waiting for anything."""
        body = error_json(f"{MAX_CONNECTIONS} visitors are served already; wait a moment and try again")
        head = (f"HTTP/1.1 503 Service Unavailable\r\nContent-Type: application/json; charset=utf-8\r\n"
                f"Content-Length: {len(body)}\r\nRetry-After: 1\r\nConnection: close\r\n\r\n")  # fmt: skip
        connection.setblocking(False)
        try:
            connection.send(head.encode() + body)
            connection.shutdown(socket.SHUT_WR)
        except OSError:  # the visitor has left
            self.shutdown_request(connection)
            return
        self._refused.append((time.monotonic(), connection))


def error_json(message: str) -> bytes:
    """One sentence as JSON."""
    return json.dumps({"error": message}).encode()
