"""HTTP server with bounded numbers of connections and of bytes in memory; requests beyond the bounds get an error."""

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
"""longest wait until a dropped connection has ended"""
LINGER_S = 1.0
"""time that a refused connection stays open, so that the client can read the reason"""


class FullError(Exception):
    """The budget has no room within the time limit."""


class ByteBudget:
    """Budget of bytes in memory, shared by all threads."""

    def __init__(self, total: int) -> None:
        self._free, self._changed = total, threading.Condition()

    @contextmanager
    def taken(self, count: int, wait_s: float) -> Iterator[None]:
        """Reserve `count` bytes. FullError when they are not free within `wait_s`."""
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
    """Server with at most MAX_CONNECTIONS connections, each with its own thread.

    A further connection replaces the one that has been silent for longest, or gets status 503 when all are busy. A handler calls
    `silent` before it waits for a request, and `busy` when it has one.
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
        """Serve a connection in its own thread, or refuse it when MAX_CONNECTIONS are busy."""
        if not (self._seats.acquire(blocking=False) or (self._drop() and self._seats.acquire(timeout=DROP_S))):
            self._refuse(request)
            return
        self.silent(request)
        try:
            super().process_request(request, client_address)
        except Exception:  # no thread was started to release the seat; after an interrupt there may be one, and the server ends
            self._seats.release()
            raise

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Serve a connection until it ends."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self.busy(request)
            self._seats.release()

    def silent(self, connection: socket.socket) -> None:
        """Record that a connection waits for a request and may be dropped."""
        with self._lock:
            self._silent[connection] = None

    def busy(self, connection: socket.socket) -> None:
        """Record that a connection has a request, or has ended."""
        with self._lock:
            self._silent.pop(connection, None)

    def _drop(self) -> bool:
        """Close the connection that has been silent for longest, if any; its thread then ends."""
        with self._lock:
            oldest = next(iter(self._silent), None)
            if oldest is None:
                return False
            del self._silent[oldest]
            with suppress(OSError):  # the client has left
                oldest.shutdown(socket.SHUT_RDWR)
            return True

    def service_actions(self) -> None:
        """Close refused connections after LINGER_S, or at once when there are many."""
        while self._refused and (self._refused[0][0] < time.monotonic() - LINGER_S or len(self._refused) > MAX_CONNECTIONS):
            self.shutdown_request(self._refused.popleft()[1])

    def server_close(self) -> None:
        """Stop listening."""
        super().server_close()
        for _, connection in self._refused:
            connection.close()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Print the traceback of a failure, unless the client left or did not read the answer."""
        if not isinstance(sys.exc_info()[1], ConnectionError | TimeoutError):
            super().handle_error(request, client_address)

    def _refuse(self, connection: socket.socket) -> None:
        """Send status 503 without blocking."""
        body = error_json(f"{MAX_CONNECTIONS} visitors are served already; wait a moment and try again")
        head = (f"HTTP/1.1 503 Service Unavailable\r\nContent-Type: application/json; charset=utf-8\r\n"
                f"Content-Length: {len(body)}\r\nRetry-After: 1\r\nConnection: close\r\n\r\n")  # fmt: skip
        connection.setblocking(False)
        try:
            connection.send(head.encode() + body)
            connection.shutdown(socket.SHUT_WR)
        except OSError:  # the client has left
            self.shutdown_request(connection)
            return
        self._refused.append((time.monotonic(), connection))


def error_json(message: str) -> bytes:
    """Encode an error message as JSON."""
    return json.dumps({"error": message}).encode()
