"""The order that people number files in: 1, 2, 10, where plain text has 1, 10, 2."""

from __future__ import annotations

import re

ZERO = ord("0")


def natural_key(name: str) -> tuple[tuple[tuple[int, int], ...], str]:
    """What to sort names by: digits count as one number, every other character as itself. Names whose numbers have as many digits
    keep the order of plain text; two names are never equal.
    """
    parts = re.findall(r"[0-9]+|[^0-9]", name)
    return tuple((ZERO, int(part)) if part[0] in "0123456789" else (ord(part), 0) for part in parts), name
