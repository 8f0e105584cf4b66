"""Memory of freed tensors goes back to the system."""

from __future__ import annotations

import platform
import subprocess
import sys

import pytest

from afford.models.freed_memory import BLOCK

MIB = 1 << 20
COUNT, SIZE = 80, BLOCK + BLOCK // 4
HELD_MIB = """
import sys
from pathlib import Path
import numpy as np
from afford.models.freed_memory import return_freed_blocks

def anonymous():
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("RssAnon")) / 1024

if sys.argv[1] == "returned":
    return_freed_blocks()
count, size = int(sys.argv[2]), int(sys.argv[3])
np.ones(2 * size, np.uint8)
before = anonymous()
blocks = [np.ones(size, np.uint8) for _ in range(count)]
del blocks[:-1]
sys.stdout.write(str(anonymous() - before))
"""


def held_mib(how: str) -> float:
    """Memory in MiB that a process keeps of `COUNT` blocks, of which all but the last are freed."""
    command = [sys.executable, "-c", HELD_MIB, how, str(COUNT), str(SIZE)]
    return float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc" or sys.platform != "linux", reason="an allocator without this setting")
def test_freed_blocks_below_a_used_one_are_returned() -> None:
    """The default keeps them in the heap of the process, which ends with the used block."""
    one = SIZE / MIB
    assert held_mib("kept") > 0.9 * COUNT * one
    assert held_mib("returned") < 2 * one
