"""Linux Landlock: restrict the files that this process can open, also from C libraries."""

from __future__ import annotations

import ctypes
import os
import struct
from collections.abc import Iterable
from pathlib import Path

CREATE_RULESET, ADD_RULE, RESTRICT_SELF, NO_NEW_PRIVS = 444, 445, 446, 38
EVERYTHING = (1 << 14) - 1  # what the second version knows: read, write, list, make, remove, move
OF_FILES, READ, LIST = 0b111, 0b1101, 0b1000  # execute, write and read; execute, read and list; list


def available() -> bool:
    """Return True when the kernel supports it, in a version that allows moving files."""
    return _call(CREATE_RULESET, None, 0, 1) >= 2


def restrict(listable: Iterable[Path], readable: Iterable[Path], writable: Iterable[Path]) -> None:
    """Restrict this process to these folders and files.

    Names in some folders may be listed, some files and folders may be read, and some folders allow everything. OSError when the
    kernel refuses.
    """
    handled = struct.pack("Q", EVERYTHING)
    rules = _checked(_call(CREATE_RULESET, handled, len(handled), 0))
    for access, paths in ((LIST, listable), (READ, readable), (EVERYTHING, writable)):
        for path in paths:
            if path.exists():
                _allow(rules, path, access if path.is_dir() else access & OF_FILES)
    ctypes.CDLL(None).prctl(NO_NEW_PRIVS, 1, 0, 0, 0)
    _checked(_call(RESTRICT_SELF, rules, 0))


def _allow(rules: int, path: Path, access: int) -> None:
    place = os.open(path, os.O_PATH)
    try:
        _checked(_call(ADD_RULE, rules, 1, struct.pack("=Qi", access, place), 0))
    finally:
        os.close(place)


def _call(number: int, *arguments: object) -> int:
    return int(ctypes.CDLL(None, use_errno=True).syscall(number, *arguments))


def _checked(result: int) -> int:
    if result < 0:
        raise OSError(ctypes.get_errno(), f"Landlock: {os.strerror(ctypes.get_errno())}")
    return result
