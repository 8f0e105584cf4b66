"""HTTP server of the demo page. All files are read into memory before it starts, so no path of a request reaches the file system.

The number of connections, the bytes of bodies in memory, and the duration of a request are bounded, so that no client blocks
others.
"""

from __future__ import annotations

import io
import ipaddress
import json
import re
import socket
import time
from collections.abc import Callable, Sequence
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler
from pathlib import Path
from typing import Any
from urllib.parse import SplitResult, parse_qs, urlsplit

from afford.common.bounded import TooLargeError
from afford.common.deadline import DeadlineStream
from afford.common.errors import SourceError
from afford.twohands.demo.bounded_server import BoundedServer, ByteBudget, FullError, error_json
from afford.twohands.demo.examples import Example
from afford.twohands.demo.service import QuestionError

MAX_BODY_BYTES = 16 << 20
MAX_BODIES_BYTES = 4 * MAX_BODY_BYTES
"""total of bodies in memory; further requests wait"""
MAX_FIELDS = 8
HEAD_S = 10.0
"""time limit from the start of a connection, or the last answer, to the last header of a request"""
BODY_S = 60.0
"""time limit to receive a body, once there is room for it, and to send an answer"""
ROOM_S = 30.0
"""longest wait for room in memory"""
CHUNK_BYTES = 1 << 16
LENGTH = re.compile(r"[0-9]{1,18}")
HERE = Path(__file__).parent
PAGE = {"/": ("page.html", "text/html"), "/page.css": ("page.css", "text/css"), "/page.js": ("page.js", "text/javascript")}
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
                               "img-src 'self' blob: data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}  # fmt: skip
STATUS = (
    (QuestionError, HTTPStatus.BAD_REQUEST),
    (TooLargeError, HTTPStatus.REQUEST_ENTITY_TOO_LARGE),
    (SourceError, HTTPStatus.UNSUPPORTED_MEDIA_TYPE),
)
Ask = Callable[[bytes, str, str], dict[str, Any]]
"""(image file, task, hands) -> JSON object; SourceError for a request that is not valid"""


class RequestError(Exception):
    """Error that is sent as a status and a one-sentence message."""

    def __init__(self, status: HTTPStatus, message: str) -> None:
        super().__init__(message)
        self.status = status


class Site(BoundedServer):
    """Server of the page and the model at one address. `serve_forever` runs it; port 0 selects a free port."""

    def __init__(self, host: str, port: int, ask: Ask, about: dict[str, Any], examples: Sequence[Example]) -> None:
        """Bind the address. OSError when it cannot be bound."""
        self.address_family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self.ask, self.content, self.host = ask, content(about, examples), host
        self.room = ByteBudget(MAX_BODIES_BYTES)
        super().__init__((host, port), Handler)

    @property
    def url(self) -> str:
        """Address for a browser."""
        name = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{name}:{self.server_address[1]}/"

    @property
    def is_local(self) -> bool:
        """Check that the address can be reached from this machine only."""
        return is_loopback(self.host)


def content(about: dict[str, Any], examples: Sequence[Example]) -> dict[str, tuple[str, bytes]]:
    """Collect the responses to GET requests."""
    found = {path: (kind, (HERE / name).read_bytes()) for path, (name, kind) in PAGE.items()}
    found |= {f"/examples/{n}.jpg": ("image/jpeg", one.jpeg) for n, one in enumerate(examples)}
    listed = [{"url": f"/examples/{n}.jpg", "task": one.task} for n, one in enumerate(examples)]
    found["/model.json"] = ("application/json", json.dumps(about).encode())
    found["/examples.json"] = ("application/json", json.dumps(listed).encode())
    return found


def is_loopback(host: str) -> bool:
    """Check that a host is localhost, 127.0.0.0/8 or ::1."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


class Handler(BaseHTTPRequestHandler):
    """Handle GET of the page, its parts and the examples, and POST /predict?task=...&hands=... with an image file as the body."""

    server: Site
    protocol_version = "HTTP/1.1"
    timeout = BODY_S
    server_version, sys_version = "afford", ""

    def setup(self) -> None:
        """Wrap the connection so that reading stops at a deadline."""
        super().setup()
        self._incoming = DeadlineStream(self.connection, self.rfile.detach(), 0.0)  # type: ignore[attr-defined]  # it is a BufferedReader
        self.rfile = io.BufferedReader(self._incoming)

    def handle_one_request(self) -> None:
        """Handle one request, whose line and headers must arrive within HEAD_S."""
        self._incoming.ends = time.monotonic() + HEAD_S
        self.server.silent(self.connection)
        super().handle_one_request()

    def parse_request(self) -> bool:
        """Parse line and headers; a connection with a request is not dropped for others."""
        whole = super().parse_request()
        self.server.busy(self.connection)
        return whole

    def do_GET(self) -> None:
        """Send the page or one of its parts."""
        self._answer(self._get)

    do_HEAD = do_GET  # noqa: N815  # http.server's names

    def do_POST(self) -> None:
        """Predict a posted picture."""
        self._answer(self._post)

    def do_other(self) -> None:
        """Refuse all other methods."""
        self._answer(self._refuse)

    do_PUT = do_DELETE = do_PATCH = do_OPTIONS = do_other  # noqa: N815

    def _get(self) -> tuple[str, bytes]:
        path = self._target().path
        if path == "/predict":
            raise RequestError(HTTPStatus.METHOD_NOT_ALLOWED, "/predict: expected POST with an image as the body, got GET")
        if path not in self.server.content:
            raise RequestError(HTTPStatus.NOT_FOUND, "there is no such page; the only one is /")
        return self.server.content[path]

    def _post(self) -> tuple[str, bytes]:
        kept, self.close_connection = self.close_connection, True  # an unread body must not be parsed as a request
        length = self._length()
        try:
            with self.server.room.taken(length, ROOM_S):
                data = self._body(length)
                self.close_connection = kept
                found = self._asked(data)
        except FullError as error:
            said = "too many pictures wait already; wait a moment and ask again"
            raise RequestError(HTTPStatus.SERVICE_UNAVAILABLE, said) from error
        return "application/json", json.dumps(found, allow_nan=False).encode()

    def _asked(self, data: bytes) -> dict[str, Any]:
        url = self._target()
        if url.path != "/predict":
            raise RequestError(HTTPStatus.NOT_FOUND, "there is no such question; the only one is /predict")
        task, hands = self._question(url.query)
        try:
            return self.server.ask(data, task, hands)
        except SourceError as error:
            raise RequestError(next(status for kind, status in STATUS if isinstance(error, kind)), str(error)) from error
        except OSError as error:
            raise RuntimeError("the model failed") from error  # a client that leaves raises it too, and is not a failure

    def _target(self) -> SplitResult:
        try:
            return urlsplit(self.path)
        except ValueError as error:
            raise RequestError(HTTPStatus.BAD_REQUEST, "expected a path such as /, got a broken address") from error

    def _question(self, query: str) -> tuple[str, str]:
        """Read task and hands from the query."""
        try:
            fields = parse_qs(query, max_num_fields=MAX_FIELDS)
        except ValueError as error:
            said = f"expected the fields task and hands, got more than {MAX_FIELDS} fields; leave the others out"
            raise RequestError(HTTPStatus.BAD_REQUEST, said) from error
        return fields.get("task", [""])[-1], fields.get("hands", ["auto"])[-1]

    def _refuse(self) -> tuple[str, bytes]:
        self.close_connection = True
        raise RequestError(HTTPStatus.METHOD_NOT_ALLOWED, f"expected GET or POST, got {self.command}")

    def _length(self) -> int:
        """Read the stated length of the body, and check its limit."""
        stated = self.headers.get("Content-Length")
        if stated is None or not LENGTH.fullmatch(stated):
            status = HTTPStatus.LENGTH_REQUIRED if stated is None else HTTPStatus.BAD_REQUEST
            got = "none" if not stated else stated if len(stated) < 20 else f"{len(stated)} characters"
            raise RequestError(status, f"Content-Length: expected the length of the body in bytes, got {got}")
        length = int(stated)
        if length > MAX_BODY_BYTES:
            self._discard(length)
            most, got = MAX_BODY_BYTES >> 20, f"{length / 2**20:.1f}"
            said = f"expected an image file of at most {most} MiB, got {got} MiB; make it smaller"
            raise RequestError(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, said)
        return length

    def _body(self, length: int) -> bytes:
        """Read the body of the request."""
        self._incoming.ends = time.monotonic() + BODY_S
        try:
            data = self.rfile.read(length)
        except TimeoutError as error:
            said = f"expected {length} bytes within {BODY_S:g} s, got fewer; make the file smaller, or send it again"
            raise RequestError(HTTPStatus.REQUEST_TIMEOUT, said) from error
        if len(data) < length:
            raise RequestError(HTTPStatus.BAD_REQUEST, f"expected {length} bytes, got {len(data)}; send the file again")
        return data

    def _discard(self, length: int) -> None:
        """Read and discard a body that is too long, so that a browser reads the answer; only a part of huge or slow bodies."""
        self._incoming.ends = time.monotonic() + HEAD_S
        left = min(length, 4 * MAX_BODY_BYTES)
        try:
            while left > 0 and (chunk := self.rfile.read(min(left, CHUNK_BYTES))):
                left -= len(chunk)
        except TimeoutError:  # the part that was received is enough
            return

    def _answer(self, make: Callable[[], tuple[str, bytes]]) -> None:
        try:
            self._check_origin()
            kind, body = make()
            status = HTTPStatus.OK
        except RequestError as error:
            status, kind, body = error.status, "application/json", error_json(str(error))
        except ConnectionError:
            raise
        except Exception:
            self.close_connection = True
            self._send(HTTPStatus.INTERNAL_SERVER_ERROR, "application/json", error_json("the model failed; the terminal says how"))
            raise
        self._send(status, kind, body)

    def _check_origin(self) -> None:
        """Refuse requests of pages of other sites, also under a host name that resolves to this machine."""
        host, origin = self.headers.get("Host", ""), self.headers.get("Origin")
        try:
            name, site = urlsplit(f"//{host}").hostname or "", None if origin is None else urlsplit(origin).netloc
        except ValueError as error:
            self.close_connection = True
            said = "expected addresses in the headers Host and Origin, got a broken one"
            raise RequestError(HTTPStatus.BAD_REQUEST, said) from error
        strange = self.server.is_local and not is_loopback(name)
        if strange or site not in (None, host):
            self.close_connection = True
            raise RequestError(HTTPStatus.FORBIDDEN, f"expected a request of {self.server.url}, got one of another site")

    def _send(self, status: HTTPStatus, kind: str, body: bytes) -> None:
        self.connection.settimeout(BODY_S)
        self.send_response(status)
        for name, value in HEADERS.items():
            self.send_header(name, value)
        self.send_header("Content-Type", kind if kind.startswith("image/") else f"{kind}; charset=utf-8")
        self.send_header("Content-Length", str(len(body)))
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """Log nothing."""
