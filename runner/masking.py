"""Hide credentials in text that is recorded: values of names like `api_key`, passwords in URLs, known kinds of tokens."""

from __future__ import annotations

import re
from typing import Any

MASK = "***"
SECRETS = frozenset(("key", "keyid", "apikey", "token", "secret", "password", "passwd", "pwd", "passphrase", "credential",
                     "credentials", "signature", "sig", "authorization"))  # fmt: skip
"""last words of names of credentials: `hf_token`, `X-Amz-Signature`, `accountKey`, but neither `key_frames` nor `max_tokens`"""
WORDS = re.compile(r"[A-Z]*[a-z]+|[A-Z]+")
ASSIGNED = re.compile(r"([\w.-]+)([\"']?\s*[=:]\s*)(?:[Bb]earer\s+)?(\"[^\"]*\"|'[^']*'|[^\s\"'&;]+)")
"""name, sign, value"""
USER = re.compile(r"(?<=://)[^/@\s]+(?=@)")
"""user and password in a URL"""
TOKEN = re.compile(r"\b(?:hf_|sk-|gh[po]_|github_pat_|xox[abp]-|A[KS]IA)[A-Za-z0-9_-]{12,}")


def mask(value: Any, name: str = "") -> Any:
    """Copy a value made of text, numbers, lists and tables with every credential replaced by `***`.

    `name` is the name of the value; the name of a credential hides the whole value.
    """
    if value in (None, "") or isinstance(value, bool):
        return value
    if isinstance(value, dict):
        return {str(inner): mask(part, str(inner)) for inner, part in value.items()}
    if _is_secret(name):
        return MASK
    if isinstance(value, (list, tuple)):
        return [mask(part) for part in value]
    return mask_text(value) if isinstance(value, str) else value


def mask_text(text: str) -> str:
    """Replace credentials in a text: `token=abc` becomes `token=***`."""
    name, sign, _ = text.partition("=")
    if sign and name.replace(".", "").replace("-", "").isidentifier() and _is_secret(name):
        return f"{name}={MASK}"
    return ASSIGNED.sub(_assigned, USER.sub(MASK, TOKEN.sub(MASK, text)))


def _assigned(found: re.Match[str]) -> str:
    name, sign, value = found.groups()
    if not _is_secret(name):
        return f"{name}{sign}{mask_text(value)}" if "=" in value else found[0]  # https://host?sig=...
    quote = value[0] if value[0] in "\"'" else ""
    return f"{name}{sign}{quote}{MASK}{quote}"


def _is_secret(name: str) -> bool:
    words = [word.lower() for word in WORDS.findall(name)]
    return bool(words) and (words[-1] in SECRETS or words[-2:] == ["key", "id"])
