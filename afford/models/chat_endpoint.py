"""One question about one picture to a server that speaks OpenAI's chat protocol (vLLM, llama.cpp, Ollama, OpenAI, ...).

The key goes into one header and into no value that leaves this file: of what a server says against us only its own message is
shown, and never when it repeats the key or refuses it. No redirect is followed with it, and no exception of the library gets out.

No proxy sees the key: a server on this machine is reached without one, whatever the environment says, and only over https, where a
proxy passes on (CONNECT) what it cannot read, does a key leave this machine (`api_key.read`).
"""

from __future__ import annotations

import base64
import io
import json
import socket
import time
from functools import partial
from http.client import HTTPConnection, HTTPException, HTTPResponse, HTTPSConnection
from typing import Any, NamedTuple
from urllib.error import HTTPError
from urllib.request import HTTPHandler, HTTPRedirectHandler, HTTPSHandler, ProxyHandler, Request, build_opener

from afford.common.deadline import DeadlineStream, seconds_left
from afford.models import chat
from afford.models.chat import Endpoint

LARGEST_REPLY = 1 << 22
"""bytes; a longer reply is refused"""
PASSING = (0, 408, 409, 429)
"""what may be over soon, beside 5xx: no reply, too slow, in conflict, too many requests"""
LONGEST_PAUSE_S = 60.0
SHOWN = 200
"""characters of a server's message that an error shows"""


class Reply(NamedTuple):
    """status: of HTTP, 0 where there was no reply, `trouble` then says why. after_s: how long the server asks to wait."""

    status: int
    body: bytes = b""
    after_s: float = 0.0
    trouble: str = ""


class _NoRedirects(HTTPRedirectHandler):
    """A redirect would carry the key to somebody else."""

    def redirect_request(self, *args: Any) -> None:
        return None


class _Reply(HTTPResponse):
    """A response whose headers and body must be there at `ends`."""

    def __init__(self, ends: float, sock: socket.socket, *args: Any, **more: Any) -> None:
        super().__init__(sock, *args, **more)
        self.fp = io.BufferedReader(DeadlineStream(sock, self.fp.detach(), ends))


class _Connection(HTTPConnection):
    """A connection that lasts for its time-out, in which everything must be sent and received, a proxy's answer included."""

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        assert self.timeout is not None
        self._ends = time.monotonic() + self.timeout
        self.response_class = partial(_Reply, self._ends)  # type: ignore[assignment]  # a class or what makes one

    def connect(self) -> None:
        """Each address of the host gets an equal share of the time."""
        addresses = socket.getaddrinfo(self.host, self.port, type=socket.SOCK_STREAM)
        self.timeout = seconds_left(self._ends) / len(addresses)
        super().connect()
        self.sock.settimeout(seconds_left(self._ends))

    def send(self, data: Any) -> None:
        """All of the data."""
        if self.sock is None:
            self.connect()
        self.sock.settimeout(seconds_left(self._ends))
        super().send(data)


class _SecureConnection(HTTPSConnection, _Connection):
    """The same over TLS."""


class _Http(HTTPHandler):
    def http_open(self, request: Request) -> HTTPResponse:
        return self.do_open(_Connection, request)


class _Https(HTTPSHandler):
    def https_open(self, request: Request) -> HTTPResponse:
        return self.do_open(_SecureConnection, request)


def ask(server: Endpoint, text: str, jpeg: bytes) -> str:
    """What the model says; ValueError in one sentence when there is no answer."""
    reply = _asked(server, json.dumps(_body(server, text, jpeg)).encode())
    if reply.status != 200:
        raise ValueError(f"{server.url}: {_refusal(server, reply)}")
    if len(reply.body) > LARGEST_REPLY:
        raise ValueError(f"{server.url}: expected a reply of at most {LARGEST_REPLY >> 20} MiB, got more; check url")
    try:
        said = json.loads(reply.body)["choices"][0]["message"]["content"]
    except (ValueError, LookupError, TypeError, RecursionError):
        said = None
    if not isinstance(said, str):
        raise ValueError(f"{server.url}: expected choices[0].message.content with text, got {len(reply.body)} bytes without it; "
                         "check that url is the base address of an OpenAI-compatible server")  # fmt: skip
    return chat.refuse_key_in(said, server.key_variable, server.url)


def _body(server: Endpoint, text: str, jpeg: bytes) -> dict[str, Any]:
    picture = "data:image/jpeg;base64," + base64.b64encode(jpeg).decode("ascii")
    content = [{"type": "text", "text": text}, {"type": "image_url", "image_url": {"url": picture}}]
    return {"model": server.model, "messages": [{"role": "user", "content": content}], "temperature": 0, "seed": server.seed,
            "max_tokens": server.new_tokens}  # fmt: skip


def _asked(server: Endpoint, body: bytes) -> Reply:
    """The reply of the last try."""
    if not (server.url and server.model):
        raise ValueError("backend 'endpoint' needs a server: set `model`, and `url` to its base address, e.g. http://127.0.0.1:8000/v1")
    request = _request(server, body)
    reply = _tried(request, server.timeout_s)
    for n in range(server.retries):
        if not _again(reply):
            break
        time.sleep(min(max(server.pause_s * 2**n, reply.after_s), LONGEST_PAUSE_S))
        reply = _tried(request, server.timeout_s)
    return reply


def _request(server: Endpoint, body: bytes) -> Request:
    key = chat.read_key(server.key_variable, server.url)
    headers = {"Content-Type": "application/json", "Accept": "application/json"}
    if key:
        headers["Authorization"] = f"Bearer {key}"
    return Request(server.url.rstrip("/") + "/chat/completions", body, headers, method="POST")


def _tried(request: Request, timeout_s: float) -> Reply:
    """One try. Exceptions of the library end here: they may hold what the server said."""
    proxies = [ProxyHandler({})] if chat.is_here(request.full_url) else []
    try:
        try:
            with build_opener(_NoRedirects, _Http, _Https, *proxies).open(request, timeout=timeout_s) as reply:
                return Reply(reply.status, reply.read(LARGEST_REPLY + 1))
        except HTTPError as error:
            with error:
                return Reply(error.code, error.read(LARGEST_REPLY), _seconds(error.headers.get("Retry-After", "")))
    except OSError as error:
        reason = getattr(error, "reason", error)
        return Reply(0, trouble=f"no answer within {timeout_s:g} s" if isinstance(reason, TimeoutError) else str(reason))
    except HTTPException as error:
        return Reply(0, trouble=f"what came is not HTTP ({type(error).__name__})")


def _again(reply: Reply) -> bool:
    """Whether another try may help."""
    return reply.status in PASSING or reply.status >= 500


def _seconds(text: str) -> float:
    """A Retry-After in seconds; its other form, a date, counts as none."""
    return float(text) if text.strip().isdecimal() else 0.0


def _refusal(server: Endpoint, reply: Reply) -> str:
    """What went wrong and what to do."""
    if reply.status == 0:
        return f"cannot be asked: {reply.trouble}; is the server running, and is url right? ({server.retries + 1} tries)"
    if reply.status in (401, 403):
        who = f"the key in environment variable {server.key_variable}" if server.key_variable else "to answer without a key"
        return f"the server refused {who} ({reply.status}); check it, and key_variable, which names it"
    if 300 <= reply.status < 400:
        return f"the server sends us elsewhere ({reply.status}), which we do not follow; set url to the address that it means"
    if reply.status == 404:
        what = f"no chat completions there (url often ends in /v1), or no model {server.model!r}"
        return f"not found (404): {what}{_message(server, reply)}"
    tries = f" after {server.retries + 1} tries" if _again(reply) else ""
    return f"the server answered {reply.status}{tries}{_message(server, reply)}; mend what it says, or run again later"


def _message(server: Endpoint, reply: Reply) -> str:
    """The `error.message` of a reply in JSON, when there is one and it does not repeat the key."""
    try:
        said = json.loads(reply.body)["error"]["message"]
    except (ValueError, LookupError, TypeError, RecursionError):
        return ""
    key = chat.read_key(server.key_variable, server.url)
    if not isinstance(said, str) or (key and key in said):
        return ""
    return f": {' '.join(said.split())[:SHOWN]}"
