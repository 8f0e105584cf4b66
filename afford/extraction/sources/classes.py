"""EPIC's verb and noun classes: a word -> its class, by exact match. Words outside the map are classes of their own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from afford.common.errors import SourceError
from afford.extraction.sources.tables import read_table, whole, words

COLUMNS = ("id", "key", "instances")
UNKNOWN = -1


@dataclass(frozen=True)
class Classes:
    """A class map; empty when the source has none."""

    keys: Mapping[int, str] = field(default_factory=dict)
    """class id -> key"""
    ids: Mapping[str, int] = field(default_factory=dict)
    """word -> class id; a word that is a key belongs to that class, otherwise the first class that lists it"""

    def look_up(self, word: str, stated: int | None) -> tuple[int, str]:
        """(class id, key) of a word. A class that the source states wins; outside the map the word is its own key."""
        number = stated if stated in self.keys else self.ids.get(word)
        return (UNKNOWN, word) if number is None else (number, self.keys[number])


def read_classes(data: bytes, name: str) -> Classes:
    """The map in EPIC_100_verb_classes.csv or EPIC_100_noun_classes.csv (v2 as well). SourceError on a bad column or row."""
    keys: dict[int, str] = {}
    listed: dict[str, int] = {}
    for where, row in read_table(data, name, COLUMNS):
        number = _number(row["id"], where)
        keys[number] = row["key"]
        for word in words(row["instances"], f"{where}, column 'instances'"):
            listed.setdefault(word, number)
    return Classes(keys, listed | {key: number for number, key in keys.items()})


def _number(text: str, where: str) -> int:
    try:
        number = whole(text)
    except ValueError:
        number = UNKNOWN
    if number < 0:
        raise SourceError(f"{where}, column 'id'", "a whole number", repr(text), "correct the row")
    return number
