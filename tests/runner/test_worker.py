"""Worker preparation holds for every library, and results do not depend on memory addresses."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
LOOK = """
import json, os
import cv2, numpy as np
from afford.common.worker import prepare
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
    """The same mask at forty addresses gives one distance transform, to the last bit."""
    found = prepared()
    assert found["kinds"] == [1, 1] and found["ipp"] is False


def test_the_number_of_threads_is_that_of_the_stage() -> None:
    """The environment does not matter."""
    assert prepared(OMP_NUM_THREADS="3")["threads"] == [1, "1"]


THREADS = """
import json, os, random, sys
{before}
from afford.common.worker import prepare
prepare(seed=5, threads=1)
{after}
from threadpoolctl import threadpool_info
print(json.dumps([[pool["user_api"], pool["num_threads"]] for pool in threadpool_info()]))
"""


@pytest.mark.parametrize(("before", "after"), [
    ("import numpy", ""), ("import numpy, scipy.linalg", ""), ("", "import scipy.linalg"), ("", "import torch"),
    ("import torch", "")])
def test_blas_and_openmp_have_the_threads_of_the_task(before: str, after: str) -> None:
    """Libraries loaded before the preparation (numpy by the codec), and libraries that a stage loads later."""
    pools = output(THREADS.format(before=before, after=after), OMP_NUM_THREADS="3", OPENBLAS_NUM_THREADS="3")
    assert pools and all(threads == 1 for _, threads in pools)


STATES = """
import json, random
from afford.common.worker import prepare

def draw():
    import numpy, torch
    return [random.random(), numpy.random.rand(), torch.rand(1).item()]

found = []
for seeds in {seeds}:
    for seed in seeds:
        prepare(seed=seed, threads=1)
    found.append(draw())
print(json.dumps(found))
"""


def test_global_random_states_come_from_the_seed_of_the_task() -> None:
    """The states of `random`, numpy and torch, fresh or after other tasks, torch loaded by the stage or before."""
    first, again, other = output(STATES.format(seeds="((1, 5), (5,), (6,))"))
    (fresh,) = output(STATES.format(seeds="((5,),)"))
    assert first == again == fresh and all(a != b for a, b in zip(fresh, other, strict=True))


FONTS = """
import json
from pathlib import Path
from afford.common.worker import use_font_cache
use_font_cache(Path({store!r}))
from matplotlib.font_manager import fontManager
found = Path({store!r}).rglob("fontlist-*.json")
print(json.dumps([path.read_text() for path in found]))
"""


def test_a_flipped_byte_of_the_list_of_fonts_is_found_before_it_is_used(tmp_path: Path) -> None:
    """The list is rebuilt; another font name would change pictures."""
    script = FONTS.format(store=str(tmp_path))
    (whole,) = output(script)
    (path,) = tmp_path.rglob("fontlist-*.json")
    path.write_text(whole.replace("DejaVu", "DejaWu", 1))
    again = output(script)
    assert "DejaWu" not in again[0] and output(script) == again, "rebuilt once, then kept"


def output(script: str, **environment: str) -> Any:
    """Last line of a script's output as JSON, from its own process."""
    env = {**os.environ, "PYTHONPATH": str(ROOT), **environment}
    done = subprocess.run([sys.executable, "-c", script], env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])
