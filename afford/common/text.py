"""Text: UTF-8 and strict JSON files, natural sort order, left and right in sentences, narrations."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any, NoReturn

from afford.common.errors import SourceError
from schemas.video import OTHER


def read_utf8(path: Path, name: str) -> str:
    """Read a text file called `name`; SourceError for bytes that are not UTF-8."""
    try:
        return path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise SourceError(name, "text in UTF-8", f"byte {error.start} that is not", "save the file as UTF-8") from error


def parse_json(data: bytes, name: str) -> Any:
    """Parse strict JSON in UTF-8, without NaN and Infinity; SourceError gives file and line."""

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
    except ValueError as error:  # Python parses no integer of more than 4300 digits
        raise SourceError(name, "numbers of a usual length", "one of thousands of digits", "correct it") from error


def json_field(record: Any, key: str, kind: type, where: str) -> Any:
    """Return `record[key]` if it is of type `kind`; raise SourceError otherwise."""
    if not isinstance(record, dict):
        raise SourceError(where, "an object with fields", type(record).__name__,
                          "compare the file with docs/extraction/own-video.md")
    if not isinstance(record.get(key), kind):
        got = type(record[key]).__name__ if key in record else "nothing"
        raise SourceError(f"{where}, field {key!r}", kind.__name__, got, "compare the file with docs/extraction/own-video.md")
    return record[key]


def word_tables(document: Any, name: str) -> dict[str, dict[str, str]]:
    """Return a document that is a dict of dicts of strings; raise SourceError for any other."""
    good = isinstance(document, dict) and all(
        isinstance(row, dict) and all(isinstance(word, str) for word in row.values()) for row in document.values())
    if not good:
        raise SourceError(name, "an object of objects of strings", type(document).__name__, "get the file again")
    return dict(document)


ZERO = ord("0")


def natural_key(name: str) -> tuple[tuple[tuple[int, int], ...], str]:
    """Sort key of natural order: runs of digits compare as numbers (1, 2, 10).

    Names whose numbers have equally many digits keep the order of plain text. Two different names never compare equal.
    """
    parts = re.findall(r"[0-9]+|[^0-9]", name)
    return tuple((ZERO, int(part)) if part[0] in "0123456789" else (ord(part), 0) for part in parts), name


SIDE_WORDS = re.compile(r"\b(left|right)\b", re.IGNORECASE)


def swap_sides(text: str) -> str:
    """Exchange the whole words left and right, for example in the task of a mirrored image; the case is kept."""
    return SIDE_WORDS.sub(lambda found: _like(found.group(), OTHER[found.group().lower()]), text)


def _like(pattern: str, word: str) -> str:
    if pattern.isupper():
        return word.upper()
    return word.capitalize() if pattern[0].isupper() else word


DEFAULT_VERB = "use"
"""verb of an empty task"""


def as_narration(task: str, category: str) -> str:
    """Write task and object as a narration: 'cut bread' and knife give 'cut bread with knife'.

    The object is not repeated where the task already names it.
    """
    thing = category.replace("_", " ")
    if not thing or f" {thing} " in f" {task} ":
        return task or DEFAULT_VERB
    return f"{task} with {thing}" if task else f"{DEFAULT_VERB} {thing}"
