"""What a reader says when a source cannot be used."""

from __future__ import annotations


class SourceError(ValueError):
    """A file of a source is not usable: one sentence with file, field, what was expected, what was got, what to do."""

    def __init__(self, where: str, expected: str, got: str, fix: str) -> None:
        super().__init__(f"{where}: expected {expected}, got {got}; {fix}")
