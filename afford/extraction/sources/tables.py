"""CSV files with a header: rows as dictionaries, checked for their columns."""

from __future__ import annotations

import ast
import csv
import io
from collections.abc import Iterator, Sequence

from afford.common.errors import SourceError

LARGEST = 10**15
"""whole numbers beyond it are none of a table: frames, classes"""
UNREADABLE = (ValueError, SyntaxError, TypeError, RecursionError, MemoryError)
"""what Python raises for a text that is no literal"""


def header(data: bytes, name: str) -> tuple[str, ...]:
    """Column names of a CSV file called `name`, in lower case. SourceError when its first line is no line of a table."""
    first = data.split(b"\n", 1)[0].decode("utf-8-sig", errors="replace")
    try:
        return tuple(column.strip().lower() for column in next(csv.reader([first]), ()))
    except csv.Error as error:
        raise SourceError(name, "a CSV file with a header", str(error), "save it again") from error


def read_table(data: bytes, name: str, needed: Sequence[str]) -> Iterator[tuple[str, dict[str, str]]]:
    """(where, row) of every row; '' where a row is short. SourceError when a column is missing or it is no CSV in UTF-8."""
    found = header(data, name)
    missing = [column for column in needed if column not in found]
    if missing:
        raise SourceError(name, f"columns {', '.join(needed)}", f"no {', '.join(missing)}", "add it to the header and the rows")
    try:
        reader = csv.DictReader(io.StringIO(data.decode("utf-8-sig"), newline=""))
        reader.fieldnames = [column.strip().lower() for column in reader.fieldnames or ()]
        for row in reader:
            yield f"{name}, line {reader.line_num}", {key: value or "" for key, value in row.items() if isinstance(key, str)}
    except (csv.Error, UnicodeDecodeError) as error:
        raise SourceError(name, "a CSV file in UTF-8", str(error), "save it again") from error


def words(text: str, where: str) -> tuple[str, ...]:
    """A Python list of strings, as EPIC writes it: "['tap', 'sponge']"."""
    try:
        found = ast.literal_eval(text)
    except UNREADABLE:
        found = None
    if not isinstance(found, list) or not all(isinstance(word, str) for word in found):
        raise SourceError(where, "a list such as ['tap', 'sponge']", repr(text[:60]), "correct the row")
    return tuple(found)


def whole(text: str) -> int:
    """A whole number of at most `LARGEST`; ValueError otherwise."""
    number = int(text) if len(text) <= 2 * len(str(LARGEST)) else LARGEST + 1
    if abs(number) > LARGEST:
        raise ValueError(text)
    return number
