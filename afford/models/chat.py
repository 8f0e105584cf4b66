"""Parameters of vision-language models that are shown pictures and asked about them: on this machine, or behind a server."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from urllib.parse import urlsplit

from afford.models.weights import Pretrained

KEY = re.compile(r"[A-Za-z0-9._~+/=:-]{8,}")
"""what a header may carry; shorter ones would be found in any text"""
ESCAPE = re.compile(r"\\(?:u([0-9a-fA-F]{4})|/)")
THIS_MACHINE = ("localhost", "127.0.0.1", "::1")


def check_variable(variable: str) -> None:
    """ValueError, which does not show it, for what is no name of an environment variable; '' is fine."""
    if not re.fullmatch(r"([A-Z_][A-Z0-9_]*)?", variable):
        raise ValueError("expected the name of an environment variable in capitals, as OPENAI_API_KEY, got something else (not "
                         "shown, it may be a key); export the key under such a name")  # fmt: skip


def check_url(url: str) -> None:
    """ValueError, which does not show it, for an address of more than a scheme, a host and a path; '' is fine."""
    if url and not (_address(url) and not re.search(r"[@?#\s]", url)):
        raise ValueError("expected http(s)://HOST[:PORT]/PATH, got something else (not shown, it may hold a key); leave out "
                         "user, password and all from ? or # on")  # fmt: skip


def is_here(url: str) -> bool:
    """Whether the server of an address is on this machine."""
    return urlsplit(url).hostname in THIS_MACHINE


def check_no_key(url: str, variable: str) -> None:
    """ValueError, which does not show them, unless an address and the name of an environment variable hold no key."""
    check_variable(variable)
    check_url(url)


def read_key(variable: str, url: str) -> str:
    """The value of an environment variable, '' for no variable; ValueError, which does not show it, when it cannot be a key or
    would travel to `url` in the open.
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
    """The text; ValueError when the key stands in it, plain or with the escapes of JSON, so that it is not kept."""
    key = read_key(variable, url)
    if key and any(key in said for said in (text, ESCAPE.sub(_meant, text))):
        raise ValueError(f"{url}: the answer repeats the key of {variable}; nothing of it was kept, use another server")
    return text


def _address(url: str) -> bool:
    """Whether it has a scheme of the web, a host, and a port in range if any."""
    try:
        parts = urlsplit(url)
        return parts.scheme in ("http", "https") and bool(parts.hostname) and parts.port != 0
    except ValueError:
        return False


def _meant(escape: re.Match[str]) -> str:
    return chr(int(escape[1], 16)) if escape[1] else "/"


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
    """what the server calls its model"""
    url: str = ""
    """base address of the server, e.g. http://127.0.0.1:8000/v1"""
    key_variable: str = "OPENAI_API_KEY"
    """name of the environment variable that holds the key; '' for a server that asks for none"""
    timeout_s: float = 120.0
    """longest that a request lasts as a whole, from the connection to the last byte of the reply"""
    retries: int = 3
    """further tries when it cannot be reached, is busy or fails"""
    pause_s: float = 1.0
    """before the first of them; twice as long before each further one"""
    seed: int = 0
    """sent to the server, which may heed it"""
    new_tokens: int = 1024
    """longest answer"""

    def __post_init__(self) -> None:
        """What might be a key is not shown, and is refused before anything is written."""
        check_no_key(self.url, self.key_variable)
        if self.new_tokens < 1 or self.retries < 0 or self.timeout_s <= 0 or self.pause_s < 0:
            raise ValueError("expected new_tokens of 1 or more, timeout_s above 0, retries and pause_s of 0 or more, got "
                             f"{self.new_tokens}, {self.timeout_s}, {self.retries} and {self.pause_s}")  # fmt: skip
