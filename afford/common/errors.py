"""What a reader says when a source cannot be used."""

from __future__ import annotations

LONGEST = 500
"""characters of a sentence; beyond it what a file states is cut"""
SHOWN = 120
"""characters that are left of each part then"""


class SourceError(ValueError):
    """A file of a source is not usable: one sentence with file, field, what was expected, what was got, what to do."""

    def __init__(self, where: str, expected: str, got: str, fix: str) -> None:
        where, expected, got, fix = (" ".join(part.splitlines()) for part in (where, expected, got, fix))
        if len(where) + len(expected) + len(got) + len(fix) > LONGEST:
            where, expected, got = map(_cut, (where, expected, got))
        super().__init__(f"{where}: expected {expected}, got {got}; {fix}")


def _cut(part: str) -> str:
    """The part without its middle when it is long."""
    half = SHOWN // 2
    return part if len(part) <= SHOWN else f"{part[:half]} [...] {part[-half:]}"
