"""Error of a reader for a source that cannot be used."""

from __future__ import annotations

LONGEST = 500
"""characters of a message; longer parts of it are shortened"""
SHOWN = 120
"""characters of each part that are left after shortening"""


class SourceError(ValueError):
    """Unusable file of a source: one sentence with file, field, what is expected, what was found, and a fix."""

    def __init__(self, where: str, expected: str, got: str, fix: str) -> None:
        where, expected, got, fix = (" ".join(part.splitlines()) for part in (where, expected, got, fix))
        if len(where) + len(expected) + len(got) + len(fix) > LONGEST:
            where, expected, got = map(_cut, (where, expected, got))
        super().__init__(f"{where}: expected {expected}, got {got}; {fix}")

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle as the sentence, for worker processes that return it."""
        return _of_sentence, (str(self),)


def _of_sentence(sentence: str) -> SourceError:
    """Rebuild an error that another process raised."""
    error = SourceError.__new__(SourceError, sentence)
    error.args = (sentence,)
    return error


def _cut(part: str) -> str:
    """Remove the middle of a long text."""
    half = SHOWN // 2
    return part if len(part) <= SHOWN else f"{part[:half]} [...] {part[-half:]}"
