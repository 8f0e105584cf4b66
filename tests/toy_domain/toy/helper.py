"""Helper with a constant."""

from __future__ import annotations

MARK = "!"
UNUSED = 1


def loud(text: str) -> str:
    # a comment
    return text.upper() + MARK
