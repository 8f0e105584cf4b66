"""The key of a server: read from the environment at the moment of use, shown nowhere, and looked for in what comes back."""

from __future__ import annotations

import os
import re
from urllib.parse import urlsplit

KEY = re.compile(r"[A-Za-z0-9._~+/=:-]{8,}")
"""what a header may carry; shorter ones would be found in any text"""
ESCAPE = re.compile(r"\\(?:u([0-9a-fA-F]{4})|/)")
THIS_MACHINE = ("localhost", "127.0.0.1", "::1")


def named(variable: str) -> None:
    """ValueError, which does not show it, for what is no name of an environment variable; '' is fine."""
    if not re.fullmatch(r"([A-Z_][A-Z0-9_]*)?", variable):
        raise ValueError("expected the name of an environment variable in capitals, as OPENAI_API_KEY, got something else (not "
                         "shown, it may be a key); export the key under such a name")  # fmt: skip


def plain(url: str) -> None:
    """ValueError, which does not show it, for an address of more than a scheme, a host and a path; '' is fine."""
    if url and not (_address(url) and not re.search(r"[@?#\s]", url)):
        raise ValueError("expected http(s)://HOST[:PORT]/PATH, got something else (not shown, it may hold a key); leave out "
                         "user, password and all from ? or # on")  # fmt: skip


def is_here(url: str) -> bool:
    """Whether the server of an address is on this machine."""
    return urlsplit(url).hostname in THIS_MACHINE


def harmless(url: str, variable: str) -> None:
    """ValueError, which does not show them, unless an address and the name of an environment variable hold no key."""
    named(variable)
    plain(url)


def read(variable: str, url: str) -> str:
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


def absent(text: str, variable: str, url: str) -> str:
    """The text; ValueError when the key stands in it, plain or with the escapes of JSON, so that it is not kept."""
    key = read(variable, url)
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
