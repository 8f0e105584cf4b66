"""What a worker prepares holds for every library, and nothing depends on where in memory an array lies."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PLACES = """
import json, os, sys
import cv2, numpy as np
if sys.argv[1] == "prepared":
    from afford.worker import prepare
    prepare(seed=3, threads=1)
rng = np.random.default_rng(0)
mask = (cv2.GaussianBlur(rng.random((301, 415)).astype(np.float32), (0, 0), 9) > 0.5).view(np.uint8)
soft = rng.random((301, 415)).astype(np.float32)
def placed(array, at):
    room = np.zeros(array.nbytes + 128, np.uint8)
    start = -room.ctypes.data % 64 + at
    out = room[start : start + array.nbytes].view(array.dtype).reshape(array.shape)
    out[:] = array
    return out
found = [{cv2.distanceTransform(placed(mask, at), cv2.DIST_L2, cv2.DIST_MASK_PRECISE).tobytes() for at in range(0, 64, 4)},
         {cv2.GaussianBlur(placed(soft, at), (0, 0), 1.3).tobytes() for at in range(0, 64, 4)}]
print(json.dumps({"kinds": [len(one) for one in found], "threads": [cv2.getNumThreads(), os.environ.get("OMP_NUM_THREADS")]}))
"""


def answer(how: str, **environment: str) -> dict[str, list[object]]:
    env = {**os.environ, "PYTHONPATH": str(ROOT), **environment}
    done = subprocess.run([sys.executable, "-c", PLACES, how], env=env, capture_output=True, text=True, check=True)
    found: dict[str, list[object]] = json.loads(done.stdout.splitlines()[-1])
    return found


def test_bytes_do_not_depend_on_where_arrays_lie() -> None:
    """Sixteen places in memory, one result."""
    assert answer("prepared")["kinds"] == [1, 1]


def test_the_number_of_threads_is_that_of_the_stage() -> None:
    """Whatever the environment says."""
    assert answer("prepared", OMP_NUM_THREADS="3")["threads"] == [1, "1"]
