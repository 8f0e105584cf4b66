"""Text files in UTF-8."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any, NoReturn

from afford.common.errors import SourceError
from schemas.video import OTHER


def read_utf8(path: Path, name: str) -> str:
    """Text of a file called `name`; SourceError when a byte of it is not UTF-8."""
    try:
        return path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise SourceError(name, "text in UTF-8", f"byte {error.start} that is not", "save the file as UTF-8") from error


def parse_json(data: bytes, name: str) -> Any:
    """The document in `data`. SourceError names the file and the line when it is not strict JSON in UTF-8."""

    def refuse(word: str) -> NoReturn:
        raise SourceError(name, "finite numbers", word, "JSON has no NaN or Infinity; correct or remove the annotation")

    try:
        return json.loads(data.decode("utf-8-sig"), parse_constant=refuse)
    except SourceError:
        raise
    except UnicodeDecodeError as error:
        raise SourceError(name, "text in UTF-8", f"byte {error.start} that is not", "save the file as UTF-8") from error
    except json.JSONDecodeError as error:
        raise SourceError(f"{name}, line {error.lineno}", "JSON", error.msg, "was the file cut short? get it again") from error
    except RecursionError as error:
        raise SourceError(name, "JSON", "lists in lists beyond any use", "get the file again") from error
    except ValueError as error:  # what is left: Python reads no whole number of more than 4300 digits
        raise SourceError(name, "numbers of a usual length", "one of thousands of digits", "correct it") from error


def json_field(record: Any, key: str, kind: type, where: str) -> Any:
    """`record[key]` when it is a `kind`; SourceError otherwise."""
    if not isinstance(record, dict):
        raise SourceError(where, "an object with fields", type(record).__name__,
                          "compare the file with docs/extraction/own-video.md")
    if not isinstance(record.get(key), kind):
        got = type(record[key]).__name__ if key in record else "nothing"
        raise SourceError(f"{where}, field {key!r}", kind.__name__, got, "compare the file with docs/extraction/own-video.md")
    return record[key]


def word_tables(document: Any, name: str) -> dict[str, dict[str, str]]:
    """A table of tables of words; SourceError when it is something else."""
    good = isinstance(document, dict) and all(
        isinstance(row, dict) and all(isinstance(word, str) for word in row.values()) for row in document.values())
    if not good:
        raise SourceError(name, "an object of objects of strings", type(document).__name__, "get the file again")
    return dict(document)


ZERO = ord("0")


def natural_key(name: str) -> tuple[tuple[tuple[int, int], ...], str]:
    """What to sort names by: digits count as one number, every other character as itself. Names whose numbers have as many digits
    keep the order of plain text; two names are never equal.
    """
    parts = re.findall(r"[0-9]+|[^0-9]", name)
    return tuple((ZERO, int(part)) if part[0] in "0123456789" else (ord(part), 0) for part in parts), name


SIDE_WORDS = re.compile(r"\b(left|right)\b", re.IGNORECASE)


def swap_sides(text: str) -> str:
    """Exchange the whole words left and right; the case stays."""
    return SIDE_WORDS.sub(lambda found: _like(found.group(), OTHER[found.group().lower()]), text)


def _like(pattern: str, word: str) -> str:
    if pattern.isupper():
        return word.upper()
    return word.capitalize() if pattern[0].isupper() else word
