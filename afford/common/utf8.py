"""Text files in UTF-8."""

from __future__ import annotations

from pathlib import Path

from afford.common.errors import SourceError


def read_utf8(path: Path, name: str) -> str:
    """Text of a file called `name`; SourceError when a byte of it is not UTF-8."""
    try:
        return path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise SourceError(name, "text in UTF-8", f"byte {error.start} that is not", "save the file as UTF-8") from error
