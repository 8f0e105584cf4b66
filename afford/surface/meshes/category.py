"""What an object is, by the words of its name."""

from __future__ import annotations

import re
from collections.abc import Iterable


def name_words(name: str) -> list[str]:
    """Words of a file name in small letters: '025_phillipsScrewdriver' -> phillips, screwdriver."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)
    return [word.lower() for word in re.findall(r"[A-Za-z]+", spaced)]


def category_of(name: str, categories: Iterable[str]) -> str:
    """The category whose words stand in the name, '' for none. The last one counts ('kettle_brush' is a brush), the longest of
    those that end there.
    """
    said = name_words(name)
    best = (0, 0, "")
    for category in categories:
        wanted = name_words(category)
        for k in range(len(said) - len(wanted) + 1):
            if wanted and said[k : k + len(wanted)] == wanted:
                best = max(best, (k + len(wanted), len(wanted), category))
    return best[2]
