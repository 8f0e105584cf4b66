"""Questions to a vision-language model: its parameters, and one client for a model on this machine or behind a server.

A question is a prompt, one picture and a parser that reads the answer by its schema (`Question`). `ask` sends the question to the
backend that the parameters belong to: `Chat` to `chat_model`, `Endpoint` to `chat_endpoint`.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, TypeVar
from urllib.parse import urlsplit

from afford.common.registry import load
from afford.models.weights import Pretrained

if TYPE_CHECKING:
    import numpy as np

BACKENDS = {"vlm": "afford.models.chat_model:answer", "endpoint": "afford.models.chat_endpoint:answer"}
Answer = TypeVar("Answer")


@dataclass(frozen=True)
class Chat(Pretrained):
    """A vision-language model on this machine."""

    model: str = ""
    """local folder or hub id"""
    new_tokens: int = 1024
    """longest answer"""

    def __post_init__(self) -> None:
        if self.new_tokens < 1:
            raise ValueError(f"expected new_tokens of 1 or more, got {self.new_tokens}")


@dataclass(frozen=True)
class Endpoint:
    """A vision-language model behind an OpenAI-compatible server."""

    model: str = ""
    """name of the model on the server"""
    url: str = ""
    """base address of the server, e.g. http://127.0.0.1:8000/v1"""
    key_variable: str = "OPENAI_API_KEY"
    """name of the environment variable that holds the key; '' for a server without a key"""
    timeout_s: float = 120.0
    """longest duration of a whole request, from the connection to the last byte of the reply"""
    retries: int = 3
    """further attempts when the server cannot be reached, is busy or fails"""
    pause_s: float = 1.0
    """pause before the first retry; doubled before each further one"""
    seed: int = 0
    """seed sent to the server, which may ignore it"""
    new_tokens: int = 1024
    """longest answer"""

    def __post_init__(self) -> None:
        check_no_key(self.url, self.key_variable)
        if self.new_tokens < 1 or self.retries < 0 or self.timeout_s <= 0 or self.pause_s < 0:
            raise ValueError("expected new_tokens of 1 or more, timeout_s above 0, retries and pause_s of 0 or more, got "
                             f"{self.new_tokens}, {self.timeout_s}, {self.retries} and {self.pause_s}")  # fmt: skip


@dataclass(frozen=True)
class Question(Generic[Answer]):
    """One question about one picture."""

    prompt: str
    picture: np.ndarray
    """(h, w, 3) uint8 RGB"""
    parse: Callable[[str, str], Answer]
    """reads the text of an answer; the second argument is the name of the backend, for errors. ValueError for a bad answer."""


def ask(question: Question[Answer], params: Chat | Endpoint) -> Answer:
    """Send a question to a model and parse its answer.

    ValueError, one sentence, when the model or the server cannot be used, or when the answer does not fit the schema.
    """
    backend = "endpoint" if isinstance(params, Endpoint) else "vlm"
    return question.parse(load(BACKENDS, backend)(question.prompt, question.picture, params), backend)


def check_variable(variable: str) -> None:
    """Raise ValueError unless `variable` is the name of an environment variable or ''. The error does not show the value."""
    if not re.fullmatch(r"([A-Z_][A-Z0-9_]*)?", variable):
        raise ValueError("expected the name of an environment variable in capitals, as OPENAI_API_KEY, got something else (not "
                         "shown, it may be a key); export the key under such a name")  # fmt: skip


def check_url(url: str) -> None:
    """Raise ValueError unless `url` is a scheme, a host and a path, or ''. The error does not show the value."""
    if url and not (_is_address(url) and not re.search(r"[@?#\s]", url)):
        raise ValueError("expected http(s)://HOST[:PORT]/PATH, got something else (not shown, it may hold a key); leave out "
                         "user, password and all from ? or # on")  # fmt: skip


def check_no_key(url: str, variable: str) -> None:
    """Raise ValueError when an address or the name of a variable may hold a key. The error does not show them."""
    check_variable(variable)
    check_url(url)


def _is_address(url: str) -> bool:
    """Check that an address has the scheme http(s), a host, and no port out of range."""
    try:
        parts = urlsplit(url)
        return parts.scheme in ("http", "https") and bool(parts.hostname) and parts.port != 0
    except ValueError:
        return False
