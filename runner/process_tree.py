"""CPU time and memory of this process and of all processes below it, as the kernel reports them now."""

from __future__ import annotations

import os
import sys
from typing import NamedTuple


class Usage(NamedTuple):
    """Resources of a process tree."""

    cpu_s: float
    """user and system time, ended children included"""
    rss_mib: float
    processes: int


def tree_usage() -> Usage:
    """Usage of this process and its descendants; without /proc (not Linux), of this process and its ended children."""
    if not os.path.isdir("/proc/self/task"):
        return _own_usage()
    cpu_s, rss, seen, todo = 0.0, 0, 0, [os.getpid()]
    while todo:
        found = _process(todo.pop())
        if found is not None:
            cpu_s, rss, seen = cpu_s + found[0], rss + found[1], seen + 1
            todo += found[2]
    return Usage(cpu_s / os.sysconf("SC_CLK_TCK"), rss * os.sysconf("SC_PAGE_SIZE") / 2**20, seen)


def _process(pid: int) -> tuple[int, int, list[int]] | None:
    """(clock ticks, pages in memory, children) of a process; None when it has ended."""
    try:
        with open(f"/proc/{pid}/stat", encoding="utf-8", errors="replace") as stream:
            fields = stream.read().rpartition(")")[2].split()
        return sum(map(int, fields[11:15])), int(fields[21]), _children(pid)
    except (FileNotFoundError, ProcessLookupError):
        return None


def _children(pid: int) -> list[int]:
    found = []
    for thread in os.listdir(f"/proc/{pid}/task"):
        with open(f"/proc/{pid}/task/{thread}/children", encoding="ascii") as stream:
            found += [int(child) for child in stream.read().split()]
    return found


def _own_usage() -> Usage:
    import resource

    own, ended = resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s = own.ru_utime + own.ru_stime + ended.ru_utime + ended.ru_stime
    return Usage(cpu_s, own.ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10), 1)
