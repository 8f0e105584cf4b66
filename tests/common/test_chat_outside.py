"""Requests to a model server: no proxy and no other host sees the key, and each try ends at its deadline."""

from __future__ import annotations

import shutil
import socket
import ssl
import subprocess
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

from afford.models import chat_endpoint
from afford.models.chat import Endpoint, check_url
from afford.models.chat_endpoint import complete
from tests.helpers.chat_server import GOOD, KEY, VARIABLE, Answer, says, serving

PROXIES = ("http_proxy", "https_proxy", "all_proxy", "HTTP_PROXY", "HTTPS_PROXY", "ALL_PROXY")
MANY = 400
"""pieces that a slow server would send, 40 ms apart"""


@pytest.fixture(autouse=True)
def planted(monkeypatch: pytest.MonkeyPatch) -> None:
    """The key in the environment, and nothing about proxies."""
    monkeypatch.setenv(VARIABLE, KEY)
    for name in (*PROXIES, "no_proxy", "NO_PROXY"):
        monkeypatch.delenv(name, raising=False)


def endpoint(url: str, **more: Any) -> Endpoint:
    given: dict[str, Any] = {"url": url, "model": "some-vlm", "key_variable": VARIABLE, "timeout_s": 20.0, "retries": 0,
                             "pause_s": 0.0, "seed": 0, "new_tokens": 9}  # fmt: skip
    return Endpoint(**{**given, **more})


@dataclass
class Listener:
    """A port on this machine, and every byte that came to it."""

    port: int
    seen: list[bytes] = field(default_factory=list)

    @property
    def everything(self) -> bytes:
        return b"".join(self.seen)


@contextmanager
def listening(serve: Callable[[socket.socket, Listener], None]) -> Iterator[Listener]:
    """Call `serve` with each connection, in a thread."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        here = Listener(server.getsockname()[1])

        def accept() -> None:
            while True:
                try:
                    connection, _ = server.accept()
                except OSError:  # the test is over
                    return
                threading.Thread(target=attended, args=(connection,), daemon=True).start()

        def attended(connection: socket.socket) -> None:
            with connection:
                serve(connection, here)

        threading.Thread(target=accept, daemon=True).start()
        yield here
        server.shutdown(socket.SHUT_RDWR)


def proxy(connection: socket.socket, here: Listener) -> None:
    """Note what comes and answer that it will not be passed on."""
    here.seen.append(connection.recv(1 << 20))
    connection.sendall(b"HTTP/1.1 502 Bad Gateway\r\nContent-Length: 0\r\n\r\n")


# -- the key -----------------------------------------------------------------------------------------------------------


def test_requests_to_this_machine_bypass_proxies(monkeypatch: pytest.MonkeyPatch) -> None:
    """Proxies of the environment are ignored; the server gets key and question."""
    with listening(proxy) as between, serving(lambda _: says(GOOD)) as server:
        for name in PROXIES:
            monkeypatch.setenv(name, f"http://127.0.0.1:{between.port}")
        for host in ("127.0.0.1", "localhost"):
            assert complete(endpoint(server.url.replace("127.0.0.1", host)), "what?", b"jpeg") == GOOD
    assert between.seen == [] and [asked.key for asked in server.asked] == [KEY, KEY]


def test_a_key_does_not_leave_this_machine_without_tls(monkeypatch: pytest.MonkeyPatch) -> None:
    """Refused before anything is sent, with a proxy as without; without a key the proxy of the environment is used."""
    with listening(proxy) as between:
        for name in PROXIES:
            monkeypatch.setenv(name, f"http://127.0.0.1:{between.port}")
        with pytest.raises(ValueError, match="would travel in the open"):
            complete(endpoint("http://model.example/v1"), "what?", b"jpeg")
        assert between.seen == []
        with pytest.raises(ValueError, match="answered 502"):
            complete(endpoint("http://model.example/v1", key_variable=""), "what?", b"jpeg")
    assert between.everything.startswith(b"POST http://model.example/v1/chat/completions")
    assert KEY.encode() not in between.everything


@pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl makes the certificate")
def test_a_proxy_passes_on_tls_without_seeing_the_key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """CONNECT is all that it reads; the server behind it gets the key."""
    monkeypatch.setenv("SSL_CERT_FILE", str(certificate(tmp_path, "model.example")))
    with (serving(lambda _: says(GOOD)) as server, listening(tls(tmp_path, urlsplit(server.url).port or 0)) as secure,
          listening(tunnel(secure.port)) as between):  # fmt: skip
        monkeypatch.setenv("https_proxy", f"http://127.0.0.1:{between.port}")
        assert complete(endpoint("https://model.example/v1"), "what?", b"jpeg") == GOOD
    assert between.everything.startswith(b"CONNECT model.example:443") and len(between.everything) > 1000
    assert KEY.encode() not in between.everything and b"Bearer" not in between.everything
    assert [asked.key for asked in server.asked] == [KEY]


def certificate(folder: Path, name: str) -> Path:
    """A certificate that vouches for itself, with its key, in one file."""
    command = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", f"/CN={name}", "-addext",
               f"subjectAltName=DNS:{name}", "-keyout", folder / "key.pem", "-out", folder / "cert.pem"]  # fmt: skip
    subprocess.run(command, check=True, capture_output=True)
    return folder / "cert.pem"


def tls(folder: Path, port: int) -> Callable[[socket.socket, Listener], None]:
    """A server with TLS before one without, on `port`."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(folder / "cert.pem", folder / "key.pem")

    def serve(connection: socket.socket, here: Listener) -> None:
        with context.wrap_socket(connection, server_side=True) as text, socket.create_connection(("127.0.0.1", port)) as behind:
            relay(text, behind, here)

    return serve


def tunnel(port: int) -> Callable[[socket.socket, Listener], None]:
    """A proxy that reads CONNECT and passes the rest on to `port`."""

    def serve(connection: socket.socket, here: Listener) -> None:
        head = b""
        while not head.endswith(b"\r\n\r\n"):
            head += connection.recv(1)
        here.seen.append(head)
        connection.sendall(b"HTTP/1.1 200 OK\r\n\r\n")
        with socket.create_connection(("127.0.0.1", port)) as behind:
            relay(connection, behind, here)

    return serve


def relay(one: socket.socket, other: socket.socket, here: Listener) -> None:
    """Bytes both ways until one end closes; those from `one` are noted."""

    def back() -> None:
        while data := other.recv(1 << 16):
            one.sendall(data)

    answering = threading.Thread(target=back, daemon=True)
    answering.start()
    while data := one.recv(1 << 16):
        here.seen.append(data)
        other.sendall(data)
    other.shutdown(socket.SHUT_WR)
    answering.join()


@pytest.mark.parametrize("status", [301, 302, 303, 307, 308])
def test_a_redirect_carries_nothing_to_another_host(status: int) -> None:
    """The redirect is refused in one sentence; the other server is not reached."""
    with listening(proxy) as other:
        answer = Answer(status, None, (("Location", f"http://127.0.0.1:{other.port}/v1/chat/completions"),))
        with serving(lambda _: answer) as server, pytest.raises(ValueError, match="sends us elsewhere"):
            complete(endpoint(server.url), "what?", b"jpeg")
    assert other.seen == [] and len(server.asked) == 1


# -- the deadline ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("at_once", "piece"), [
    (b"", b"H"), (b"HTTP/1.1 200 OK\r\n", b"X-A: b\r\n"), (b"HTTP/1.1 200 OK\r\nX: ", b"b"),
    (b"", b"HTTP/1.1 100 Continue\r\n\r\n"), (b"HTTP/1.1 200 OK\r\nContent-Length: 4000\r\n\r\n", b" "),
    (b"HTTP/1.1 200 OK\r\n\r\n", b" "), (b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n", b"1\r\n \r\n"),
    (b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n1", b";"), (b"HTTP/1.1 500 No\r\nContent-Length: 4000\r\n\r\n", b" "),
], ids=["status", "headers", "a header", "continue", "body", "no length", "chunks", "a chunk", "refusal"])  # fmt: skip
def test_a_slow_server_is_dropped_at_the_deadline(at_once: bytes, piece: bytes) -> None:
    """Wherever it is slow: the silence between two pieces never lasts as long as timeout_s, the request does."""
    sent, left = [0], threading.Event()

    def dribble(connection: socket.socket, here: Listener) -> None:
        connection.recv(1 << 20)
        try:
            connection.sendall(at_once)
            while sent[0] < MANY and not left.wait(0.04):
                connection.sendall(piece)
                sent[0] += 1
        except OSError:  # the client has left
            return

    with listening(dribble) as server, pytest.raises(ValueError, match=r"no answer within 0\.5 s"):
        complete(endpoint(f"http://127.0.0.1:{server.port}/v1", timeout_s=0.5), "what?", b"jpeg")
    left.set()
    assert 0 < sent[0] < MANY / 2


def test_a_server_that_does_not_read_is_dropped_at_the_deadline() -> None:
    """A picture that does not fit into the buffers on the way."""
    done = threading.Event()

    def deaf(connection: socket.socket, here: Listener) -> None:
        done.wait(20)

    with listening(deaf) as server, pytest.raises(ValueError, match=r"no answer within 0\.5 s"):
        complete(endpoint(f"http://127.0.0.1:{server.port}/v1", timeout_s=0.5), "what?", bytes(32 << 20))
    done.set()


def test_a_reply_without_end_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """No more of it is kept than an answer may have."""
    monkeypatch.setattr(chat_endpoint, "LARGEST_REPLY", 1 << 20)

    def flood(connection: socket.socket, here: Listener) -> None:
        connection.recv(1 << 20)
        connection.sendall(b"HTTP/1.1 200 OK\r\n\r\n")
        try:
            for _ in range(1 << 12):
                connection.sendall(bytes(1 << 16))
                here.seen.append(b"x")
        except OSError:  # the client has left
            return

    with listening(flood) as server, pytest.raises(ValueError, match="expected a reply of at most 1 MiB, got more"):
        complete(endpoint(f"http://127.0.0.1:{server.port}/v1"), "what?", b"jpeg")
    assert len(server.seen) < 1 << 11


@pytest.mark.parametrize("url", ["http://[", "http://host:99999999/v1", "http://host:0/v1", "http://host:port/v1"])
def test_an_invalid_address_is_refused(url: str) -> None:
    """The address is refused before anything is sent."""
    with pytest.raises(ValueError, match=r"expected http\(s\)://HOST"):
        check_url(url)
