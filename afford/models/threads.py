"""One thread for a model's inference on a CPU, whatever the process uses elsewhere."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch


@contextmanager
def one_thread(device: str) -> Iterator[None]:
    """One intra-op thread of torch on a CPU, afterwards as many as before; nothing on another device.

    Small models gain little from a second thread and lose much where another process has its core; with one thread the result is
    also the same on every number of cores. The number belongs to the calling thread: other threads keep theirs.
    """
    before = torch.get_num_threads()
    if torch.device(device).type != "cpu" or before == 1:
        yield
        return
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
