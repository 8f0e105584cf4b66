"""Errors of readers: one sentence about a file of a source that cannot be used."""

from __future__ import annotations

LONGEST = 240
"""characters of one part of a sentence; what a file states may be of any length"""


class SourceError(ValueError):
    """A file of a source is not usable: one sentence with file, field, what was expected, what was got, what to do."""

    def __init__(self, where: str, expected: str, got: str, fix: str) -> None:
        super().__init__(f"{short(where)}: expected {short(expected)}, got {short(got)}; {short(fix)}")


def short(text: str, longest: int = LONGEST) -> str:
    """Text on one line of at most `longest` characters."""
    line = text if text.isprintable() else "".join(letter if letter.isprintable() else " " for letter in text)
    return line if len(line) <= longest else f"{line[:longest - 4]} ..."
