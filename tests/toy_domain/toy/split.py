"""Split a word: word -> its parts."""

from __future__ import annotations

from dataclasses import dataclass

from toy.log import note
from toy.values import Word


@dataclass(frozen=True)
class Params:
    parts: int = 2


def run(word: Word, params: Params) -> tuple[Word, ...]:
    note("split", word.name)
    return tuple(Word(f"{word.name}.{i}", f"{word.text}{i}") for i in range(params.parts))
