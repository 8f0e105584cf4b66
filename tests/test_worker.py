"""What a worker prepares holds for every library, and nothing depends on where in memory an array lies."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LOOK = """
import json, os
import cv2, numpy as np
from afford.worker import prepare
prepare(seed=3, threads=1)
found, rng = [], np.random.default_rng(0)
for height, width, y, x in ((81, 104, 23, 69), (121, 101, 26, 52)):
    mask, kept = np.ones((height, width), np.uint8), []
    mask[y : y + 18, x : x + 15] = 0
    kinds = set()
    for _ in range(40):
        kept.append(np.zeros(int(rng.integers(100, 300000)), np.uint8))
        kinds.add(cv2.distanceTransform(mask.copy(), cv2.DIST_L2, cv2.DIST_MASK_PRECISE).tobytes())
    found.append(len(kinds))
print(json.dumps({"kinds": found, "ipp": cv2.ipp.useIPP(), "threads": [cv2.getNumThreads(), os.environ["OMP_NUM_THREADS"]]}))
"""


def prepared(**environment: str) -> dict[str, object]:
    env = {**os.environ, "PYTHONPATH": str(ROOT), **environment}
    done = subprocess.run([sys.executable, "-c", LOOK], env=env, capture_output=True, text=True, check=True)
    found: dict[str, object] = json.loads(done.stdout.splitlines()[-1])
    return found


def test_bytes_do_not_depend_on_where_arrays_lie() -> None:
    """The same mask forty times, wherever memory has room for it: one distance, to the last bit."""
    found = prepared()
    assert found["kinds"] == [1, 1] and found["ipp"] is False


def test_the_number_of_threads_is_that_of_the_stage() -> None:
    """Whatever the environment says."""
    assert prepared(OMP_NUM_THREADS="3")["threads"] == [1, "1"]
