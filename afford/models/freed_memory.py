"""Memory of freed tensors, returned to the system, so that a process takes what its tensors take."""

from __future__ import annotations

import ctypes

BLOCK = 1 << 20
"""bytes of a block from which it is mapped by itself"""
MMAP_THRESHOLD = -3
"""number of M_MMAP_THRESHOLD in mallopt(3)"""


def return_freed_blocks() -> None:
    """Have glibc map each block of `BLOCK` bytes or more by itself, for the rest of this process, and unmap it when it is freed.

    By default glibc does so only until the first such block is freed. Blocks of up to 32 MiB then share a heap, whose freed pages
    stay with the process while anything above them is used. Other C libraries are left as they are.
    """
    setting = getattr(ctypes.CDLL(None), "mallopt", None)
    if setting is not None:
        setting(MMAP_THRESHOLD, BLOCK)
