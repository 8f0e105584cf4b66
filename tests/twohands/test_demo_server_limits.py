"""The local page under visitors that are broken, slow, many or gone: a sentence for each, nothing on the terminal."""

from __future__ import annotations

import http.client
import json
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from select import select
from typing import Any

import pytest

from afford.twohands.demo import bounded_server, server
from afford.twohands.demo.server import Site

MANY = 400
"""pieces that a slow visitor would send, 40 ms apart"""
Ask = Callable[[bytes, str, str], dict[str, Any]]


@contextmanager
def serving(ask: Ask = lambda data, task, hands: {"bytes": len(data), "task": task}) -> Iterator[Site]:
    """A page with a stand-in for the model."""
    with Site("127.0.0.1", 0, ask, {}, []) as site:
        thread = threading.Thread(target=site.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True)
        thread.start()
        try:
            yield site
        finally:
            site.shutdown()


def connected(site: Site) -> socket.socket:
    return socket.create_connection(("127.0.0.1", site.server_address[1]), timeout=20)


def reply(connection: socket.socket) -> tuple[int, Any]:
    """Status and JSON of what the server sends."""
    found = http.client.HTTPResponse(connection)
    found.begin()
    body = found.read()
    return found.status, json.loads(body) if found.headers.get_content_type() == "application/json" else body


def told(site: Site, request: bytes) -> tuple[int, Any]:
    with connected(site) as connection:
        connection.sendall(request)
        return reply(connection)


def post(query: str, body: bytes = b"abc", **headers: str) -> bytes:
    fields = {"Host": "localhost", "Content-Length": str(len(body)), **headers}
    head = "".join(f"{name}: {value}\r\n" for name, value in fields.items())
    return f"POST /predict?{query} HTTP/1.1\r\n{head}\r\n".encode() + body


def settled(before: int) -> None:
    """Wait until every visitor's thread has ended."""
    while threading.active_count() > before:
        time.sleep(0.01)


# -- broken ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("request_", "hint"), [
    (b"GET / HTTP/1.1\r\nHost: [\r\n\r\n", "headers Host and Origin"),
    (b"GET / HTTP/1.1\r\nHost: localhost\r\nOrigin: http://[\r\n\r\n", "headers Host and Origin"),
    (b"GET http://[ HTTP/1.1\r\nHost: localhost\r\n\r\n", "expected a path"),
    (b"POST http://[ HTTP/1.1\r\nHost: localhost\r\nContent-Length: 0\r\n\r\n", "expected a path"),
    (post("task=x", b"", **{"Content-Length": "9" * 5000}), "got 5000 characters"),
    (post("task=x", b"", **{"Content-Length": "²"}), "expected the length of the body in bytes"),
    (post("task=x", b"", **{"Content-Length": "+3"}), "expected the length of the body in bytes, got +3"),
    (post("&".join(f"a{n}=1" for n in range(9))), "got more than 8 fields"),
    (post("task=x&" * 200), "got more than 8 fields"),
], ids=["host", "origin", "target", "post target", "5000 digits", "superscript", "plus", "9 fields", "200 fields"])  # fmt: skip
def test_a_broken_request_is_400_and_a_sentence(request_: bytes, hint: str, capfd: pytest.CaptureFixture[str]) -> None:
    """No traceback; the next request is answered."""
    with serving() as site:
        status, said = told(site, request_)
        assert status == 400 and hint in said["error"] and "\n" not in said["error"]
        assert told(site, post("task=x")) == (200, {"bytes": 3, "task": "x"})
    assert capfd.readouterr().err == ""


def test_an_unread_body_is_not_parsed_as_a_request() -> None:
    """The connection ends after a refusal that leaves the body unread."""
    with serving() as site, connected(site) as connection:
        connection.sendall(post("task=x", post("task=hidden"), **{"Content-Length": "x"}))
        assert reply(connection)[0] == 400 and connection.recv(1) == b""


# -- slow --------------------------------------------------------------------------------------------------------------


def dribbled(site: Site, start: bytes, piece: bytes) -> tuple[int, bytes]:
    """Number of pieces sent until the server answered or closed, and the reply."""
    with connected(site) as connection:
        connection.sendall(start)
        for count in range(MANY):
            if select([connection], [], [], 0.04)[0]:
                return count, b"".join(iter(lambda: connection.recv(1 << 16), b""))
            connection.send(piece)
    return MANY, b""


@pytest.mark.parametrize("start", [b"", b"GET / HTTP/1.1\r\n", b"GET / HTTP/1.1\r\nHost: "])
def test_half_a_request_is_left_at_its_deadline(start: bytes, monkeypatch: pytest.MonkeyPatch,
                                                capfd: pytest.CaptureFixture[str]) -> None:  # fmt: skip
    """However regularly its bytes come; its thread ends."""
    monkeypatch.setattr(server, "HEAD_S", 0.4)
    before = threading.active_count()
    with serving() as site:
        count, said = dribbled(site, start, b"x: y\r\n" if start.endswith(b"\n") else b"x")
        assert count < MANY / 2 and said == b""
    settled(before)
    assert capfd.readouterr().err == ""


def test_a_slow_body_is_408(monkeypatch: pytest.MonkeyPatch) -> None:
    """A slow body beyond the size limit is 413."""
    monkeypatch.setattr(server, "BODY_S", 0.4)
    monkeypatch.setattr(server, "HEAD_S", 0.4)
    with serving() as site:
        count, said = dribbled(site, post("task=x", b"", **{"Content-Length": "4000"}), b"x")
        assert count < MANY / 2 and b" 408 " in said and b"expected 4000 bytes within 0.4 s" in said
        count, said = dribbled(site, post("task=x", b"", **{"Content-Length": str(server.MAX_BODY_BYTES + 1)}), b"x")
        assert count < MANY / 2 and b" 413 " in said


# -- many --------------------------------------------------------------------------------------------------------------


def test_a_crowd_waits_at_the_door() -> None:
    """A hundred connections before the server takes the first: none is lost."""
    site = Site("127.0.0.1", 0, lambda data, task, hands: {}, {}, [])
    with site, ExitStack() as stack:
        bounded_server = [stack.enter_context(connected(site)) for _ in range(100)]
        for one in bounded_server:
            one.sendall(b"GET /model.json HTTP/1.1\r\nHost: localhost\r\n\r\n")
        threading.Thread(target=site.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True).start()
        assert [reply(one) for one in bounded_server] == [(200, {})] * 100
        site.shutdown()


HELLO = b"GET /model.json HTTP/1.1\r\nHost: localhost\r\n\r\n"


def test_connections_at_once_are_bounded(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    """One more than are served is 503 and a sentence; when one of them has its answer there is a place."""
    monkeypatch.setattr(bounded_server, "MAX_CONNECTIONS", 3)
    asked, may_end = threading.Semaphore(0), threading.Event()

    def slow(data: bytes, task: str, hands: str) -> dict[str, Any]:
        asked.release()
        may_end.wait(20)
        return {}

    with serving(slow) as site, ExitStack() as stack:
        held = [stack.enter_context(connected(site)) for _ in range(3)]
        for one in held:
            one.sendall(post("task=x"))
            asked.acquire()
        for _ in range(20):
            status, said = told(site, HELLO)
            assert status == 503 and said["error"].startswith("3 visitors are served already; wait")
        may_end.set()
        assert [reply(one) for one in held] == [(200, {})] * 3
        assert told(site, HELLO) == (200, {})
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("sent", [b"", b"GET / HTTP/1.1\r\n", HELLO], ids=["nothing", "half a request", "a whole one, kept open"])
def test_silent_connections_block_no_client(sent: bytes, monkeypatch: pytest.MonkeyPatch,
                                            capfd: pytest.CaptureFixture[str]) -> None:  # fmt: skip
    """Many more than may be open: the oldest of them give way, every visitor is answered, threads do not pile up."""
    monkeypatch.setattr(bounded_server, "MAX_CONNECTIONS", 8)
    before = threading.active_count()
    with serving() as site, ExitStack() as stack:
        for _ in range(60):
            one = stack.enter_context(connected(site))
            one.sendall(sent)
            assert sent != HELLO or reply(one) == (200, {})
        assert told(site, post("task=x"))[0] == 200
        assert threading.active_count() <= before + 1 + 8
    assert capfd.readouterr().err == ""


def test_bodies_in_memory_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those that find no room wait for it, and are refused with 503 when there is none in time."""
    monkeypatch.setattr(server, "MAX_BODIES_BYTES", 2000)
    held, most, count, may_end = 0, 0, threading.Lock(), threading.Event()

    def slow(data: bytes, task: str, hands: str) -> dict[str, Any]:
        nonlocal held, most
        with count:
            held += len(data)
            most = max(most, held)
        may_end.wait(20)
        with count:
            held -= len(data)
        return {}

    found: list[int] = []

    def visit() -> None:
        found.append(told(site, post("task=x", bytes(900)))[0])

    visitors = [threading.Thread(target=visit) for _ in range(8)]
    with serving(slow) as site:
        for visitor in visitors[:2]:
            visitor.start()
        while held < 1800:
            time.sleep(0.01)
        with monkeypatch.context() as patched:
            patched.setattr(server, "ROOM_S", 0.2)
            status, said = told(site, post("task=x", bytes(900)))
        assert status == 503 and "too many pictures wait already" in said["error"]
        for visitor in visitors[2:]:
            visitor.start()
        may_end.set()
        for visitor in visitors:
            visitor.join()
        assert found == [200] * 8 and most == 1800
        assert told(site, post("task=x", bytes(2000)))[0] == 200


# -- gone --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("sent", [b"", b"GET / HT", post("task=x"), post("task=x", b"", **{"Content-Length": "4000"})],
                         ids=["nothing", "half a line", "all", "no body"])  # fmt: skip
def test_a_client_that_leaves_is_not_a_failure(sent: bytes, capfd: pytest.CaptureFixture[str]) -> None:
    """A reset at any moment prints nothing."""
    left, before = threading.Event(), threading.active_count()

    def answers(data: bytes, task: str, hands: str) -> dict[str, Any]:
        left.wait(20)
        return {"much": "x" * (8 << 20)}

    with serving(answers) as site:
        connection = connected(site)
        connection.sendall(sent)
        time.sleep(0.05)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        connection.close()
        left.set()
    settled(before)
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("error", [RuntimeError, TimeoutError, ConnectionError])
def test_a_failure_of_the_model_is_no_visitor_who_left(error: type[Exception], capfd: pytest.CaptureFixture[str]) -> None:
    """500, and the traceback on the terminal, whatever the model raises."""
    before = threading.active_count()

    def broken(data: bytes, task: str, hands: str) -> dict[str, Any]:
        raise error("out of paper")

    with serving(broken) as site:
        status, said = told(site, post("task=x"))
    settled(before)
    assert status == 500 and "terminal" in said["error"] and "out of paper" in capfd.readouterr().err


def test_an_interrupt_while_a_connection_begins_ends_the_server(monkeypatch: pytest.MonkeyPatch) -> None:
    """The thread of the connection has left its seat by then, and no second error hides the interrupt."""
    begin, before = bounded_server.ThreadingHTTPServer.process_request, threading.active_count()

    def interrupted(site: Site, request: Any, client_address: Any) -> None:
        begin(site, request, client_address)
        settled(before)
        raise KeyboardInterrupt

    monkeypatch.setattr(bounded_server.ThreadingHTTPServer, "process_request", interrupted)
    with Site("127.0.0.1", 0, lambda data, task, hands: {}, {}, []) as site:
        site.timeout = 20
        with connected(site) as connection:
            connection.sendall(b"GET / HTTP/1.0\r\nHost: localhost\r\n\r\n")
            with pytest.raises(KeyboardInterrupt):
                site.handle_request()
