"""The page over HTTP. Everything it can give is in memory before it starts: no path of a request reaches the file system."""

from __future__ import annotations

import ipaddress
import json
import socket
from collections.abc import Callable, Mapping, Sequence
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

from afford.bounded import TooLargeError
from afford.demo.answer import QuestionError
from afford.demo.examples import Example
from afford.readers.errors import SourceError

MAX_BODY_BYTES = 16 << 20
CHUNK_BYTES = 1 << 16
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


class Site(ThreadingHTTPServer):
    """A page and a model, on one address. `serve_forever` runs it; port 0 takes any that is free."""

    daemon_threads = True

    def __init__(self, host: str, port: int, ask: Ask, about: dict[str, Any], examples: Sequence[Example]) -> None:
        """OSError when the address cannot be had."""
        self.address_family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self.ask, self.content, self.host = ask, content(about, examples), host
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
    timeout = 30
    server_version, sys_version = "afford", ""

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
        path = urlsplit(self.path).path
        if path == "/predict":
            raise RequestError(HTTPStatus.METHOD_NOT_ALLOWED, "/predict: expected POST with an image as the body, got GET")
        if path not in self.server.content:
            raise RequestError(HTTPStatus.NOT_FOUND, "there is no such page; the only one is /")
        return self.server.content[path]

    def _post(self) -> tuple[str, bytes]:
        url, data = urlsplit(self.path), self._body()
        if url.path != "/predict":
            raise RequestError(HTTPStatus.NOT_FOUND, "there is no such question; the only one is /predict")
        fields = parse_qs(url.query, max_num_fields=8)
        try:
            found = self.server.ask(data, fields.get("task", [""])[-1], fields.get("hands", ["auto"])[-1])
        except SourceError as error:
            raise RequestError(next(status for kind, status in STATUS if isinstance(error, kind)), str(error)) from error
        return "application/json", json.dumps(found, allow_nan=False).encode()

    def _refuse(self) -> tuple[str, bytes]:
        self.close_connection = True
        raise RequestError(HTTPStatus.METHOD_NOT_ALLOWED, f"expected GET or POST, got {self.command}")

    def _body(self) -> bytes:
        """The body of the request, which states its length and is not too long."""
        stated = self.headers.get("Content-Length")
        if stated is None or not stated.isdecimal():
            self.close_connection = True
            status = HTTPStatus.LENGTH_REQUIRED if stated is None else HTTPStatus.BAD_REQUEST
            raise RequestError(status, f"Content-Length: expected the length of the body, got {stated or 'none'}")
        if int(stated) > MAX_BODY_BYTES:
            self._pass_over(int(stated))
            most, got = MAX_BODY_BYTES >> 20, int(stated) / 2**20
            said = f"expected an image file of at most {most} MiB, got {got:.1f} MiB; make it smaller"
            raise RequestError(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, said)
        data = self.rfile.read(int(stated))
        if len(data) < int(stated):
            self.close_connection = True
            raise RequestError(HTTPStatus.BAD_REQUEST, f"expected {stated} bytes, got {len(data)}; send the file again")
        return data

    def _pass_over(self, length: int) -> None:
        """Read a body that is too long and forget it, so that the browser gets to read the answer; of huge ones only a part."""
        self.close_connection = True
        left = min(length, 4 * MAX_BODY_BYTES)
        while left > 0 and (chunk := self.rfile.read(min(left, CHUNK_BYTES))):
            left -= len(chunk)

    def _answer(self, make: Callable[[], tuple[str, bytes]]) -> None:
        try:
            self._check_origin()
            kind, body = make()
            status = HTTPStatus.OK
        except RequestError as error:
            status, kind, body = error.status, "application/json", _told(str(error))
        except ConnectionError:
            raise
        except Exception:
            self.close_connection = True
            self._send(HTTPStatus.INTERNAL_SERVER_ERROR, "application/json", _told("the model failed; the terminal says how"))
            raise
        self._send(status, kind, body)

    def _check_origin(self) -> None:
        """A page of another site may neither ask nor, by a name that points here, read."""
        host, origin = self.headers.get("Host", ""), self.headers.get("Origin")
        name = urlsplit(f"//{host}").hostname or ""
        strange = self.server.is_local and not is_loopback(name)
        if strange or (origin is not None and urlsplit(origin).netloc != host):
            self.close_connection = True
            raise RequestError(HTTPStatus.FORBIDDEN, f"expected a request of {self.server.url}, got one of another site")

    def _send(self, status: HTTPStatus, kind: str, body: bytes) -> None:
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


def _told(message: str) -> bytes:
    return json.dumps({"error": message}).encode()
