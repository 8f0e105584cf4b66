"""The same bytes every time: thread count and algorithms of torch, for as long as a training lasts."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

import torch


@contextmanager
def repeatable(threads: int, device: str) -> Iterator[None]:
    """So many threads, and on a CUDA device only algorithms that give the same result twice; afterwards as before. (On a CPU what a
    model does here gives the same result with the same number of threads.)

    It must come before the first matrix product on the device, because cuBLAS reads its workspace setting once.
    """
    before = torch.get_num_threads(), torch.are_deterministic_algorithms_enabled()
    torch.set_num_threads(threads)
    if device == "cuda":
        os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")
        torch.use_deterministic_algorithms(True)
    try:
        yield
    finally:
        torch.set_num_threads(before[0])
        if device == "cuda":
            torch.use_deterministic_algorithms(before[1])
