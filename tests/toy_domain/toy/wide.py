"""Return the word, on two cores: word -> word."""

from __future__ import annotations

from toy.log import note
from toy.values import Word

THREADS = 2


def run(word: Word) -> Word:
    note("wide", word.name)
    return word
