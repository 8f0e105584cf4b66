"""The unpickler with an allow-list: functions of a file are never run, and its memory and time are bounded."""

from __future__ import annotations

import os
import pickle
import struct
from pathlib import Path
from typing import Any

import pytest

from afford.common.unpickle import Opaque, RefusedError, SafeUnpickler


class Trap:
    """Unpickling this in the usual way makes a folder."""

    def __init__(self, place: Path) -> None:
        self.place = place

    def __reduce__(self) -> Any:
        return os.mkdir, (str(self.place),)


@pytest.mark.parametrize("opaque", [True, False])
@pytest.mark.parametrize("protocol", [2, 4, 5])
def test_a_function_that_is_not_listed_is_never_run(tmp_path: Path, protocol: int, opaque: bool) -> None:
    data = pickle.dumps({"a": 1, "trap": Trap(tmp_path / "sprung")}, protocol)
    if opaque:
        found = SafeUnpickler(data, {}, opaque=True).load()
        assert found["a"] == 1 and isinstance(found["trap"], Opaque)
    else:
        with pytest.raises(RefusedError, match=r"posix\.mkdir"):
            SafeUnpickler(data, {}).load()
    assert not (tmp_path / "sprung").exists()
    pickle.loads(data)
    assert (tmp_path / "sprung").exists()  # the trap works


def test_a_listed_function_is_called_by_its_name_only() -> None:
    """A function of the reader is neither an attribute of another object nor reached through a class of the file."""
    data = b"\x80\x02" + b"cours\nsum\n" + b"K\x01K\x02\x86\x85R."
    assert SafeUnpickler(data, {"ours.sum": sum}).load() == 3
    with pytest.raises(RefusedError, match=r"ours\.sum"):
        SafeUnpickler(data, {"theirs.sum": sum}).load()
    for called in (b"X\x03\x00\x00\x00abc", b"K\x05", b"}", b"]"):
        with pytest.raises(RefusedError, match="a call of a"):
            SafeUnpickler(b"\x80\x02" + called + b")R.", {"ours.sum": sum}, opaque=True).load()


DEEP_KEY = b"\x80\x02}" + b")" + b"q\x00h\x00\x86" * 200 + b"Ns."
"""a dictionary whose key is a pair of pairs, 200 deep: its hash takes 2^200 steps"""


@pytest.mark.parametrize("data", [
    b"\x80\x05\x96" + struct.pack("<Q", 1 << 40) + b".", b"\x80\x02}" * (1 << 13) + b".", DEEP_KEY,
    b"\x80\x04\x8d" + struct.pack("<Q", 1 << 60) + b"a.", b"cos\nsystem\n.", b"I1\n.", b"\x80\x02Pos\n.", b"\x80\x02.",
    b"\x80\x02(t", b"\x80\x02h\x05.", b"\x80\x02X\x01\x00\x00\x00aQ.", b"",
], ids=["byte array", "opcodes", "key", "text", "name", "text opcode", "text reference", "empty stack", "mark", "memo", "reference",
        "empty file"])  # fmt: skip
def test_a_bomb_or_a_damaged_pickle_is_refused_in_one_sentence(data: bytes) -> None:
    with pytest.raises(RefusedError) as error:
        SafeUnpickler(data, {}, max_opcodes=1 << 12).load()
    assert str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("data", [b"\x80\x02Nr\xff\xff\xff\x7f.", b"\x80\x04\x95" + struct.pack("<Q", 1 << 60) + b"N."])
def test_stated_indices_and_lengths_take_no_memory(data: bytes) -> None:
    """A memo index of 2^31 costs one entry, a frame of 2^60 bytes those that are there."""
    assert SafeUnpickler(data, {}).load() is None
