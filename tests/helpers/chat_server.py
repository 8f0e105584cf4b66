"""A server on this machine that speaks the chat protocol: answers are given by the test, questions are kept."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from email.message import Message
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, NamedTuple

import pytest

from stages.surface import part_describe
from tests.helpers.blocks import changed

KEY, VARIABLE = "sk-planted-6f1d09b7c2/e84a+5", "A_KEY_FOR_TESTS"
SHAFT = {"part": "shaft", "role": "negative", "looks": "a long thin rod at the end", "reason": "A slip stabs like a narwhal.",
         "confidence": 0.75, "task_changes": True}  # fmt: skip
GRIP = {"part": "handle", "role": "positive", "looks": "a thick bar", "reason": "It is made for it.", "confidence": 1,
        "task_changes": True}  # fmt: skip
GOOD = json.dumps({"category": "screwdriver", "parts": [SHAFT, GRIP]})
"""an answer as it is asked for"""


class Asked(NamedTuple):
    """One request as it came."""

    path: str
    headers: Message
    body: Any

    @property
    def key(self) -> str:
        return str(self.headers.get("Authorization", "")).removeprefix("Bearer ")


class Answer(NamedTuple):
    """Reply of the server; `raw` replaces the JSON."""

    status: int
    value: Any = None
    headers: tuple[tuple[str, str], ...] = ()
    raw: bytes | None = None


@dataclass
class ChatServer:
    """Address of the server, and the requests that it got."""

    url: str
    asked: list[Asked] = field(default_factory=list)


def says(text: object) -> Answer:
    """An answer of a model."""
    return Answer(200, {"choices": [{"message": {"role": "assistant", "content": text}, "finish_reason": "stop"}]})


def plant(monkeypatch: pytest.MonkeyPatch) -> None:
    """The key in the environment, and no proxy on the way to this machine."""
    monkeypatch.setenv(VARIABLE, KEY)
    monkeypatch.setenv("no_proxy", "127.0.0.1")


def params(server: ChatServer, **more: Any) -> part_describe.Params:
    """Ask this server about one task, without pauses."""
    given: dict[str, Any] = {"url": server.url, "model": "some-vlm", "key_variable": VARIABLE,
                             "pause_s": 0.0, "tasks": ("drive a screw",), "timeout_s": 20.0}  # fmt: skip
    return changed(part_describe.Params(backend="endpoint"), **{**given, **more})


@contextmanager
def serving(answer: Callable[[Asked], Answer]) -> Iterator[ChatServer]:
    """The server while it runs; `answer` is called with every request."""

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
            here.asked.append(Asked(self.path, self.headers, body))
            self._send(answer(here.asked[-1]))

        def do_GET(self) -> None:
            here.asked.append(Asked(self.path, self.headers, None))
            self._send(Answer(200, {}))

        def log_message(self, *args: object) -> None:
            """Quiet."""

        def _send(self, reply: Answer) -> None:
            data = json.dumps(reply.value).encode() if reply.raw is None else reply.raw
            self.send_response(reply.status)
            for name, value in (*reply.headers, ("Content-Length", str(len(data)))):
                self.send_header(name, value)
            self.end_headers()
            self.wfile.write(data)

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    here = ChatServer(f"http://127.0.0.1:{server.server_port}/v1")
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True)
    thread.start()
    try:
        yield here
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
