"""Batches made ahead of their use by threads. Which batch comes when does not depend on who is quicker."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")


def ahead(make: Callable[[int], T], numbers: Iterable[int], workers: int, depth: int = 4) -> Iterator[T]:
    """`make(n)` for every number, in order, up to `depth` of them made in advance; `workers` 0 makes each when it is due."""
    if workers == 0:
        yield from map(make, numbers)
        return
    with ThreadPoolExecutor(workers) as pool:
        due: deque[Future[T]] = deque()
        try:
            for number in numbers:
                due.append(pool.submit(make, number))
                if len(due) > depth:
                    yield due.popleft().result()
            while due:
                yield due.popleft().result()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
