"""Classes that emerge from the narrations: EPIC's where they apply, in EPIC's order, then every new word as its own class."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Classes:
    """The verb classes, or the noun classes, of one data set. A class is known by its key; its label is its place here."""

    keys: tuple[str, ...]
    """one per class"""
    epic_ids: tuple[int, ...]
    """EPIC-KITCHENS id of each class, -1 for a new one"""

    def labels(self) -> dict[str, int]:
        """Key -> label."""
        return {key: label for label, key in enumerate(self.keys)}


def emerge(seen: Iterable[tuple[str, int]]) -> Classes:
    """Classes out of (key, EPIC id or -1) pairs in any order, any number of times."""
    epic_id: dict[str, int] = {}
    for key, number in seen:
        epic_id[key] = max(number, epic_id.get(key, -1))
    keys = sorted(epic_id, key=lambda key: (epic_id[key] < 0, epic_id[key], key))
    return Classes(tuple(keys), tuple(epic_id[key] for key in keys))
