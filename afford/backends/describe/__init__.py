"""Question: which parts of this thing must a hand not touch for this task, and where does it belong?"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from schemas.negative import PartDescription


class Describer(Protocol):
    """What every backend of this folder looks like."""

    def __call__(self, name: str, category: str, task: str) -> PartDescription:
        """Describe the object `name`, which is said to be a `category` ('' when nobody said), for `task` in words ('' for any use).

        Category 'unknown' and no notes for what it does not know: a describer never guesses. Pure and deterministic.
        """
        ...
