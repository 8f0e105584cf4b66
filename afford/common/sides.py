"""Left and right in a sentence: what a task is called in a mirror."""

from __future__ import annotations

import re

from schemas.video import OTHER

SIDE_WORDS = re.compile(r"\b(left|right)\b", re.IGNORECASE)


def swap_sides(text: str) -> str:
    """Exchange the whole words left and right; the case stays."""
    return SIDE_WORDS.sub(lambda found: _like(found.group(), OTHER[found.group().lower()]), text)


def _like(pattern: str, word: str) -> str:
    if pattern.isupper():
        return word.upper()
    return word.capitalize() if pattern[0].isupper() else word
