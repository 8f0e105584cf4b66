"""Client of a server that speaks OpenAI's chat protocol (vLLM, llama.cpp, Ollama, OpenAI, ...).

The key is read from the environment when a request is made. It is put into one header and into no other value: errors show only
the server's own message, and only if that message does not contain the key. Exceptions of the HTTP library are converted, because
their text may contain what the server sent. Redirects are not followed.

Proxies never see the key: a server on this machine is reached without a proxy, whatever the environment says. To other machines a
key is sent over https only, where a proxy forwards encrypted bytes (CONNECT).
"""

from __future__ import annotations

import base64
import io
import json
import os
import re
import socket
import time
from functools import partial
from http.client import HTTPConnection, HTTPException, HTTPResponse, HTTPSConnection
from typing import Any, NamedTuple
from urllib.error import HTTPError
from urllib.parse import urlsplit
from urllib.request import HTTPHandler, HTTPRedirectHandler, HTTPSHandler, ProxyHandler, Request, build_opener

import numpy as np

from afford.common.deadline import DeadlineStream, seconds_left
from afford.common.image_files import encode_jpeg
from afford.models.chat import Endpoint

JPEG_QUALITY = 90
LARGEST_REPLY = 1 << 22
"""bytes; a longer reply is refused"""
RETRIED = (0, 408, 409, 429)
"""HTTP states that may pass, besides 5xx: no reply, time-out, conflict, too many requests"""
LONGEST_PAUSE_S = 60.0
SHOWN = 200
"""characters of a server's message that an error shows"""
KEY = re.compile(r"[A-Za-z0-9._~+/=:-]{8,}")
"""form of a key that a header can carry; a shorter key would occur in ordinary text by chance"""
ESCAPE = re.compile(r"\\(?:u([0-9a-fA-F]{4})|/)")
THIS_MACHINE = ("localhost", "127.0.0.1", "::1")


class Reply(NamedTuple):
    """Reply of a server to one request."""

    status: int
    """HTTP status, 0 without a reply"""
    body: bytes = b""
    after_s: float = 0.0
    """seconds that the server wants the client to wait before a retry"""
    trouble: str = ""
    """reason for a missing reply"""


def answer(prompt: str, rgb: np.ndarray, params: Endpoint) -> str:
    """Answer of the model to a prompt about a picture (h, w, 3) uint8 RGB. ValueError, one sentence, when there is no answer."""
    return complete(params, prompt, encode_jpeg(rgb, JPEG_QUALITY).tobytes())


def complete(server: Endpoint, prompt: str, jpeg: bytes) -> str:
    """Send one chat completion request with a JPEG file, and return the text of the reply.

    ValueError, one sentence: no server or key, no or a bad reply, or a reply that contains the key.
    """
    reply = _send_with_retries(server, json.dumps(_body(server, prompt, jpeg)).encode())
    if reply.status != 200:
        raise ValueError(f"{server.url}: {_refusal(server, reply)}")
    if len(reply.body) > LARGEST_REPLY:
        raise ValueError(f"{server.url}: expected a reply of at most {LARGEST_REPLY >> 20} MiB, got more; check url")
    try:
        text = json.loads(reply.body)["choices"][0]["message"]["content"]
    except (ValueError, LookupError, TypeError, RecursionError):
        text = None
    if not isinstance(text, str):
        raise ValueError(f"{server.url}: expected choices[0].message.content with text, got {len(reply.body)} bytes without it; "
                         "check that url is the base address of an OpenAI-compatible server")  # fmt: skip
    return refuse_key_in(text, server.key_variable, server.url)


def read_key(variable: str, url: str) -> str:
    """Value of an environment variable, '' when `variable` is ''.

    ValueError, which does not show the value, when it cannot be a key or would be sent to `url` without encryption.
    """
    if not variable:
        return ""
    key, where = os.environ.get(variable, ""), f"environment variable {variable}"
    if not key:
        raise ValueError(f"{where}: expected the key of {url}, got nothing; export it, or set key_variable to '' for no key")
    if not KEY.fullmatch(key):
        raise ValueError(f"{where}: expected a key of 8 or more letters, digits and ._~+/=:-, got something else (not shown)")
    if urlsplit(url).scheme != "https" and not is_here(url):
        raise ValueError(f"{url}: the key of {variable} would travel in the open; use https, or set key_variable to '' for no key")
    return key


def refuse_key_in(text: str, variable: str, url: str) -> str:
    """Return `text`; ValueError when it contains the key, plain or with JSON escapes."""
    key = read_key(variable, url)
    if key and any(key in form for form in (text, ESCAPE.sub(_unescape, text))):
        raise ValueError(f"{url}: the answer repeats the key of {variable}; nothing of it was kept, use another server")
    return text


def is_here(url: str) -> bool:
    """Check that the server of an address is on this machine."""
    return urlsplit(url).hostname in THIS_MACHINE


def _unescape(escape: re.Match[str]) -> str:
    return chr(int(escape[1], 16)) if escape[1] else "/"


def _body(server: Endpoint, prompt: str, jpeg: bytes) -> dict[str, Any]:
    picture = "data:image/jpeg;base64," + base64.b64encode(jpeg).decode("ascii")
    content = [{"type": "text", "text": prompt}, {"type": "image_url", "image_url": {"url": picture}}]
    return {"model": server.model, "messages": [{"role": "user", "content": content}], "temperature": 0, "seed": server.seed,
            "max_tokens": server.new_tokens}  # fmt: skip


def _send_with_retries(server: Endpoint, body: bytes) -> Reply:
    """Reply of the last attempt."""
    if not (server.url and server.model):
        raise ValueError("backend 'endpoint' needs a server: set `model`, and `url` to its base address, e.g. http://127.0.0.1:8000/v1")
    headers = {"Content-Type": "application/json", "Accept": "application/json"}
    if key := read_key(server.key_variable, server.url):
        headers["Authorization"] = f"Bearer {key}"
    request = Request(server.url.rstrip("/") + "/chat/completions", body, headers, method="POST")
    reply = _send(request, server.timeout_s)
    for n in range(server.retries):
        if not _is_retried(reply):
            break
        time.sleep(min(max(server.pause_s * 2**n, reply.after_s), LONGEST_PAUSE_S))
        reply = _send(request, server.timeout_s)
    return reply


def _send(request: Request, timeout_s: float) -> Reply:
    """Reply of one attempt. Exceptions of the HTTP library end here, because they may contain what the server sent."""
    proxies = [ProxyHandler({})] if is_here(request.full_url) else []
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
        return Reply(0, trouble=f"the reply is not HTTP ({type(error).__name__})")


def _is_retried(reply: Reply) -> bool:
    return reply.status in RETRIED or reply.status >= 500


def _seconds(text: str) -> float:
    """Seconds of a Retry-After header; 0 for its other form, a date."""
    return float(text) if text.strip().isdecimal() else 0.0


def _refusal(server: Endpoint, reply: Reply) -> str:
    """Sentence about a failed request: the reason, and what to do."""
    if reply.status == 0:
        return f"cannot be asked: {reply.trouble}; is the server running, and is url right? ({server.retries + 1} tries)"
    if reply.status in (401, 403):
        refused = f"the key in environment variable {server.key_variable}" if server.key_variable else "to answer without a key"
        return f"the server refused {refused} ({reply.status}); check it, and key_variable, which names it"
    if 300 <= reply.status < 400:
        return f"the server sends us elsewhere ({reply.status}), which we do not follow; set url to the address that it means"
    if reply.status == 404:
        missing = f"no chat completions there (url often ends in /v1), or no model {server.model!r}"
        return f"not found (404): {missing}{_message(server, reply)}"
    tries = f" after {server.retries + 1} tries" if _is_retried(reply) else ""
    return f"the server answered {reply.status}{tries}{_message(server, reply)}; mend what it says, or run again later"


def _message(server: Endpoint, reply: Reply) -> str:
    """Field `error.message` of a JSON reply; '' when there is none, or when it contains the key."""
    try:
        text = json.loads(reply.body)["error"]["message"]
    except (ValueError, LookupError, TypeError, RecursionError):
        return ""
    key = read_key(server.key_variable, server.url)
    if not isinstance(text, str) or (key and key in text):
        return ""
    return f": {' '.join(text.split())[:SHOWN]}"


class _NoRedirects(HTTPRedirectHandler):
    """Follow no redirect: it would send the key to another server."""

    def redirect_request(self, *args: Any) -> None:
        return None


class _Reply(HTTPResponse):
    """Response whose headers and body must arrive before the monotonic time `ends`."""

    def __init__(self, ends: float, sock: socket.socket, *args: Any, **more: Any) -> None:
        super().__init__(sock, *args, **more)
        self.fp = io.BufferedReader(DeadlineStream(sock, self.fp.detach(), ends))


class _Connection(HTTPConnection):
    """Connection with one deadline for everything that is sent and received, including the answer of a proxy."""

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        assert self.timeout is not None
        self._ends = time.monotonic() + self.timeout
        self.response_class = partial(_Reply, self._ends)  # type: ignore[assignment]  # a class or what makes one

    def connect(self) -> None:
        """Connect to the first address of the host that answers; each address gets an equal share of the time."""
        addresses = socket.getaddrinfo(self.host, self.port, type=socket.SOCK_STREAM)
        self.timeout = seconds_left(self._ends) / len(addresses)
        super().connect()
        self.sock.settimeout(seconds_left(self._ends))

    def send(self, data: Any) -> None:
        """Send all of the data before the deadline."""
        if self.sock is None:
            self.connect()
        self.sock.settimeout(seconds_left(self._ends))
        super().send(data)


class _SecureConnection(HTTPSConnection, _Connection):
    """The same connection over TLS."""


class _Http(HTTPHandler):
    def http_open(self, request: Request) -> HTTPResponse:
        return self.do_open(_Connection, request)


class _Https(HTTPSHandler):
    def https_open(self, request: Request) -> HTTPResponse:
        return self.do_open(_SecureConnection, request)
