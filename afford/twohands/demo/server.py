"""The page over HTTP. Everything it can give is in memory before it starts: no path of a request reaches the file system.

Connections, bodies in memory and the time that a request takes to come are bounded, so that no visitor keeps the others out.
"""

from __future__ import annotations

import io
import ipaddress
import json
import re
import socket
import time
from collections.abc import Callable, Mapping, Sequence
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
"""of all bodies that are in memory at once; further ones wait on their way"""
MAX_FIELDS = 8
HEAD_S = 10.0
"""from the first moment of a connection, or the last answer, to the last header of a request"""
BODY_S = 60.0
"""for the body to come, once there is room for it; and for an answer to be taken"""
ROOM_S = 30.0
"""longest wait for room"""
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
Content = Mapping[str, tuple[str, bytes]]
"""path of a request -> content type and body"""
Ask = Callable[[bytes, str, str], dict[str, Any]]
"""(image file, task, hands) -> what is sent as JSON; SourceError for what cannot be answered"""


class RequestError(Exception):
    """A request that is answered by a status and one sentence."""

    def __init__(self, status: HTTPStatus, message: str) -> None:
        super().__init__(message)
        self.status = status


class Site(BoundedServer):
    """A page and a model, on one address. `serve_forever` runs it; port 0 takes any that is free."""

    def __init__(self, host: str, port: int, ask: Ask, about: dict[str, Any], examples: Sequence[Example]) -> None:
        """OSError when the address cannot be had."""
        self.address_family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self.ask, self.content, self.host = ask, content(about, examples), host
        self.room = ByteBudget(MAX_BODIES_BYTES)
        super().__init__((host, port), Handler)

    @property
    def url(self) -> str:
        """Where a browser finds it."""
        name = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{name}:{self.server_address[1]}/"

    @property
    def is_local(self) -> bool:
        """Only programs on this machine reach it."""
        return is_loopback(self.host)


def content(about: dict[str, Any], examples: Sequence[Example]) -> dict[str, tuple[str, bytes]]:
    """Everything that GET can give."""
    found = {path: (kind, (HERE / name).read_bytes()) for path, (name, kind) in PAGE.items()}
    found |= {f"/examples/{n}.jpg": ("image/jpeg", one.jpeg) for n, one in enumerate(examples)}
    listed = [{"url": f"/examples/{n}.jpg", "task": one.task} for n, one in enumerate(examples)]
    found["/model.json"] = ("application/json", json.dumps(about).encode())
    found["/examples.json"] = ("application/json", json.dumps(listed).encode())
    return found


def is_loopback(host: str) -> bool:
    """localhost, 127.0.0.0/8 and ::1."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


class Handler(BaseHTTPRequestHandler):
    """GET gives the page, its parts and the examples; POST /predict?task=...&hands=... takes an image file as its body."""

    server: Site
    protocol_version = "HTTP/1.1"
    timeout = BODY_S
    server_version, sys_version = "afford", ""

    def setup(self) -> None:
        """The connection, read until a deadline."""
        super().setup()
        self._incoming = DeadlineStream(self.connection, self.rfile.detach(), 0.0)  # type: ignore[attr-defined]  # it is a BufferedReader
        self.rfile = io.BufferedReader(self._incoming)

    def handle_one_request(self) -> None:
        """One request, whose line and headers must come within HEAD_S."""
        self._incoming.ends = time.monotonic() + HEAD_S
        self.server.silent(self.connection)
        super().handle_one_request()

    def parse_request(self) -> bool:
        """Whether line and headers are a request; its connection is not dropped for others."""
        whole = super().parse_request()
        self.server.busy(self.connection)
        return whole

    def do_GET(self) -> None:
        """The page and its parts."""
        self._answer(self._get)

    do_HEAD = do_GET  # noqa: N815  # http.server's names

    def do_POST(self) -> None:
        """One question."""
        self._answer(self._post)

    def do_other(self) -> None:
        """No method but these."""
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
        kept, self.close_connection = self.close_connection, True  # a body that was not read is no request
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
            raise RuntimeError("the model failed") from error  # a visitor who leaves raises it too, and is no failure

    def _target(self) -> SplitResult:
        try:
            return urlsplit(self.path)
        except ValueError as error:
            raise RequestError(HTTPStatus.BAD_REQUEST, "expected a path such as /, got a broken address") from error

    def _question(self, query: str) -> tuple[str, str]:
        """Task and hands."""
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
        """The length of the body as it is stated, which is not too long."""
        stated = self.headers.get("Content-Length")
        if stated is None or not LENGTH.fullmatch(stated):
            status = HTTPStatus.LENGTH_REQUIRED if stated is None else HTTPStatus.BAD_REQUEST
            got = "none" if not stated else stated if len(stated) < 20 else f"{len(stated)} characters"
            raise RequestError(status, f"Content-Length: expected the length of the body in bytes, got {got}")
        length = int(stated)
        if length > MAX_BODY_BYTES:
            self._pass_over(length)
            most, got = MAX_BODY_BYTES >> 20, f"{length / 2**20:.1f}"
            said = f"expected an image file of at most {most} MiB, got {got} MiB; make it smaller"
            raise RequestError(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, said)
        return length

    def _body(self, length: int) -> bytes:
        """The body of the request."""
        self._incoming.ends = time.monotonic() + BODY_S
        try:
            data = self.rfile.read(length)
        except TimeoutError as error:
            said = f"expected {length} bytes within {BODY_S:g} s, got fewer; make the file smaller, or send it again"
            raise RequestError(HTTPStatus.REQUEST_TIMEOUT, said) from error
        if len(data) < length:
            raise RequestError(HTTPStatus.BAD_REQUEST, f"expected {length} bytes, got {len(data)}; send the file again")
        return data

    def _pass_over(self, length: int) -> None:
        """Read a body that is too long and forget it, so that the browser gets to read the answer; of huge and slow ones only a
        part.
        """
        self._incoming.ends = time.monotonic() + HEAD_S
        left = min(length, 4 * MAX_BODY_BYTES)
        try:
            while left > 0 and (chunk := self.rfile.read(min(left, CHUNK_BYTES))):
                left -= len(chunk)
        except TimeoutError:  # what has come is enough
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
        """A page of another site may neither ask nor, by a name that points here, read."""
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
        """Requests are not logged."""
