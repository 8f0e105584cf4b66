"""Plant faults in a clone, one after the other, and write which test of `make test` finds each: benchmarks/faults.md.

    PYTHONPATH=. python benchmarks/bench_faults.py [--only ROOM]

A fault replaces one piece of text that occurs once in a file. The named tests run until the first one fails. The script
ends with exit code 1 when a fault is not found, or when the tests fail without a fault.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

from benchmarks.pages import ROOT

PAGE = ROOT / "benchmarks" / "faults.md"
HEAD = """# Planted faults

Written by `benchmarks/bench_faults.py`. Each row is a fault that was planted alone in a clone, and the first test that failed.

| fault | file | found by |
|---|---|---|
"""


class Fault(NamedTuple):
    """A fault, and the tests (a folder or a file) that are expected to find it."""

    what: str
    file: str
    before: str
    after: str
    tests: str


FAULTS = (
    Fault("Hands swapped in the intersection",
          "afford/extraction/intersection.py",
          "masks[SIDES.index(entity.side)] |= mask",
          "masks[1 - SIDES.index(entity.side)] |= mask",
          "tests/extraction/test_affordance_intersect.py"),
    Fault("Frame numbers off by one in decoding",
          "afford/common/video/frames.py",
          "indices = source[numbers - 1]",
          "indices = source[np.minimum(numbers, len(source) - 1)]",
          "tests/common/test_video.py"),
    Fault("Last row of a row group lost",
          "afford/dataset/parquet_shards.py",
          "pa.Table.from_pylist(group, schema",
          "pa.Table.from_pylist(group[:-1] or group, schema",
          "tests/extraction/test_dataset_pack.py"),
    Fault("Sign of the value in generalized advantage estimation",
          "afford/grasping/rl/ppo.py",
          "next_value) - value  # delta",
          "next_value) + value  # delta",
          "tests/grasping/test_ppo.py"),
    Fault("Hinge that turns the wrong way",
          "afford/synthetic/assets/object_model.py",
          "+ np.sin(value)",
          "- np.sin(value)",
          "tests/synthetic/test_assets.py"),
    Fault("Left hand for the right one in mirrored predictions",
          "afford/twohands/model/predictor.py",
          "mirrored.probability[::-1, :, :, ::-1]",
          "mirrored.probability[:, :, :, ::-1]",
          "tests/twohands/test_predictor_mirror.py"),
    Fault("Stale cache: inputs left out of the key",
          "runner/keys.py",
          '"inputs": dict(inputs),\n        "schemas"',
          '"inputs": sorted(inputs),\n        "schemas"',
          "tests/runner/test_keys.py"),
    Fault("Positive parts taken for negative ones",
          "afford/surface/negative/project.py",
          'note.role == "negative" for note',
          'note.role == "positive" for note',
          "tests/surface/test_negative_affordance_projection.py"),
    Fault("Resumed training repeats a step",
          "afford/training/loop.py",
          "if state.stopped else state.step, plan.steps)",
          "if state.stopped else max(state.step - 1, 0), plan.steps)",
          "tests/common/test_training_loop.py"),
    Fault("Scene flow of frames in reverse order",
          "afford/rgbd/scene_flow/clip.py",
          "between(a, b) for a, b",
          "between(b, a) for a, b",
          "tests/rgbd/test_scene_flow.py"),
    Fault("Foreign names in a pickle no longer refused",
          "afford/common/unpickle.py",
          "        if self.opaque:\n            return Name",
          "        if full:\n            return Name",
          "tests/common/test_unpickle.py"),
    Fault("Time base left out of recorded samples",
          "afford/recording/extraction_results.py",
          "time_ns = EPOCH_NS + sample.time_ns",
          "time_ns = sample.time_ns",
          "tests/recording/test_recording.py"),
    Fault("Dice loss without its factor of two",
          "afford/twohands/model/losses.py",
          "overlap = 2 * (p / scale",
          "overlap = (p / scale",
          "tests/twohands/test_twohand_losses.py"),
)  # fmt: skip


def main() -> int:
    """Plant, test, restore, write; the exit code."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--only", default="", help="faults whose tests have this in their path, without writing the page")
    room = parser.parse_args().only
    faults = [fault for fault in FAULTS if room in fault.tests]
    with tempfile.TemporaryDirectory() as folder:
        clone = Path(folder) / "afford"
        subprocess.run(("git", "clone", "--quiet", ROOT, clone), check=True)
        rows = [(fault, planted(fault, clone)) for fault in faults]
    for fault, test in rows:
        print(f"{fault.what}: {test or 'NOT FOUND'}")
    if not room:
        PAGE.write_text(HEAD + "".join(f"| {fault.what} | `{fault.file}` | `{test or 'no test'}` |\n" for fault, test in rows))
    return 0 if all(test for _, test in rows) else 1


def planted(fault: Fault, clone: Path) -> str:
    """First test that fails with the fault; '' when none does. SystemExit when the text is not there once."""
    path = clone / fault.file
    source = path.read_text(encoding="utf-8")
    if source.count(fault.before) != 1:
        raise SystemExit(f"{fault.file}: {fault.before!r} occurs {source.count(fault.before)} times, expected 1")
    path.write_text(source.replace(fault.before, fault.after), encoding="utf-8")
    try:
        return first_failure(clone, fault.tests)
    finally:
        path.write_text(source, encoding="utf-8")


def first_failure(clone: Path, tests: str) -> str:
    """Name of the first failing test; '' when all pass."""
    command = (sys.executable, "-B", "-m", "pytest", "-q", "-x", "-m", "not slow and not npm and not mediapipe",
               "-p", "no:cacheprovider", tests)
    done = subprocess.run(command, cwd=clone, stdout=subprocess.PIPE, text=True)
    found = re.search(r"^(?:FAILED|ERROR) (\S+)", done.stdout, re.M)
    if done.returncode and not found:
        raise SystemExit(done.stdout)
    return found.group(1) if found else ""


if __name__ == "__main__":
    raise SystemExit(main())
