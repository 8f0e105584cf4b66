"""Memory of a task is measured without what earlier tasks left behind."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TASKS = """
import json
from runner.memory import PeakMeter, resident_mib

def task(mib, kept):
    meter.start()
    data = bytearray(b"x") * (mib << 20)
    if kept:
        left.append(data)
    del data
    return meter.peak_mib()

left, meter, bare = [], PeakMeter(), resident_mib()
print(json.dumps([bare, task(1, False), task(100, False), task(1, False), task(80, True), task(1, False), resident_mib()]))
"""


def test_the_peak_of_a_task_is_its_own() -> None:
    """Large tasks before it do not count, whether they keep their memory or free it."""
    done = subprocess.run([sys.executable, "-c", TASKS], cwd=ROOT, capture_output=True, text=True, check=True)
    bare, first, large, after, kept, last, resident = map(float, done.stdout.strip("[]\n").split(","))
    assert all(bare - 1 < one < bare + 20 for one in (first, after, last))
    assert bare + 99 < large < bare + 120 and bare + 79 < kept < bare + 100 and resident > bare + 79
