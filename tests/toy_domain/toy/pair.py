"""Split off the first letter: word -> a bundle of its first letter and the rest."""

from __future__ import annotations

from toy.log import note
from toy.values import Pair, Word


def run(word: Word) -> Pair:
    note("pair", word.name)
    return Pair(Word(word.name, word.text[:1]), Word(word.name, word.text[1:]))
