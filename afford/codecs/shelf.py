"""A list of a stored value that stays on disk: whoever walks it has one element in memory at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, overload


class Shelf(Sequence[Any]):
    """Stands where a schema says tuple. Every walk reads the files again and gives new, equal elements."""

    def __init__(self, length: int, read: Callable[[], Iterator[Any]], files: tuple[Path, ...]) -> None:
        self._length, self._read = length, read
        self.files = files
        """what a walk opens"""

    def __len__(self) -> int:
        return self._length

    def __iter__(self) -> Iterator[Any]:
        return self._read()

    @overload
    def __getitem__(self, at: int) -> Any: ...
    @overload
    def __getitem__(self, at: slice) -> tuple[Any, ...]: ...

    def __getitem__(self, at: int | slice) -> Any:
        if isinstance(at, slice):
            wanted = range(self._length)[at]
            found = {i: item for i, item in enumerate(self) if i in wanted}
            return tuple(found[i] for i in wanted)
        return next(islice(self, range(self._length)[at], None))
