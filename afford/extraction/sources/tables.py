"""CSV tables with a header, and EPIC's class maps of verbs and nouns."""

from __future__ import annotations

import ast
import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from afford.common.errors import SourceError

COLUMNS = ("id", "key", "instances")
UNKNOWN = -1


@dataclass(frozen=True)
class Classes:
    """Class map of EPIC: exact match of a word to its class; empty if the source has no class map."""

    keys: Mapping[int, str] = field(default_factory=dict)
    """class id -> key"""
    ids: Mapping[str, int] = field(default_factory=dict)
    """word -> class id; a word that is a key belongs to that class, otherwise the first class that lists it"""

    def look_up(self, word: str, stated: int | None) -> tuple[int, str]:
        """Look up the (class id, key) of a word. A class stated in the source has priority; unknown words are their own key."""
        number = stated if stated in self.keys else self.ids.get(word)
        return (UNKNOWN, word) if number is None else (number, self.keys[number])


def read_classes(data: bytes, name: str) -> Classes:
    """Read the map in EPIC_100_verb_classes.csv or EPIC_100_noun_classes.csv, also v2. SourceError for a bad column or row."""
    keys: dict[int, str] = {}
    listed: dict[str, int] = {}
    for where, row in read_table(data, name, COLUMNS):
        number = _number(row["id"], where)
        keys[number] = row["key"]
        for word in word_list(row["instances"], f"{where}, column 'instances'"):
            listed.setdefault(word, number)
    return Classes(keys, listed | {key: number for number, key in keys.items()})


def _number(text: str, where: str) -> int:
    try:
        number = whole_number(text)
    except ValueError:
        number = UNKNOWN
    if number < 0:
        raise SourceError(f"{where}, column 'id'", "a whole number", repr(text), "correct the row")
    return number


LARGEST = 10**15
"""largest valid whole number of a table: frames, classes"""
UNREADABLE = (ValueError, SyntaxError, TypeError, RecursionError, MemoryError)
"""exceptions of Python for a text that is not a literal"""


def header(data: bytes, name: str) -> tuple[str, ...]:
    """Read the column names of a CSV file called `name`, in lower case. SourceError for an unreadable first line."""
    first = data.split(b"\n", 1)[0].decode("utf-8-sig", errors="replace")
    try:
        return tuple(column.strip().lower() for column in next(csv.reader([first]), ()))
    except csv.Error as error:
        raise SourceError(name, "a CSV file with a header", str(error), "save it again") from error


def read_table(data: bytes, name: str, needed: Sequence[str]) -> Iterator[tuple[str, dict[str, str]]]:
    """Yield (where, row) of every row, '' for missing cells. SourceError for a missing column, and for invalid CSV or UTF-8."""
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


def word_list(text: str, where: str) -> tuple[str, ...]:
    """Parse a Python list of strings, as EPIC writes it: "['tap', 'sponge']"."""
    try:
        found = ast.literal_eval(text)
    except UNREADABLE:
        found = None
    if not isinstance(found, list) or not all(isinstance(word, str) for word in found):
        raise SourceError(where, "a list such as ['tap', 'sponge']", repr(text[:60]), "correct the row")
    return tuple(found)


def whole_number(text: str) -> int:
    """Parse a whole number of at most `LARGEST`; ValueError for other text."""
    number = int(text) if len(text) <= 2 * len(str(LARGEST)) else LARGEST + 1
    if abs(number) > LARGEST:
        raise ValueError(text)
    return number
