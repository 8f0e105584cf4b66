"""What is made once and used by several files of tests."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import cv2
import pytest

from commands.targets import use
from pipeline import TARGETS, build
from runner import RunReport
from tests.helpers.command import Made
from tests.helpers.tiny_source import write_source

cv2.ipp.setUseIPP(False)  # as in workers, so that a stage called here gives their bytes (tests/runner/test_worker.py)
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it, and so would what tests start

use(TARGETS, build)  # as the command line does, for tests that call its parts

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """The targets of a tiny source, made as a user makes them. Tests that change anything take `made.copy(tmp_path)`."""
    folder = tmp_path_factory.mktemp("made")
    source, store = write_source(folder / "tiny", truth=True), folder / "store"
    printed = [_pipeline(target, source, store) for target in ("dataset", "extraction-report")]
    return Made(source, store, json.loads(printed[0].splitlines()[-1]))


@pytest.fixture(scope="session")
def compared(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, RunReport]:
    """A store in which a tiny model, the baselines and another method were compared, and what the run said."""
    from tests.helpers import made_comparison

    folder = tmp_path_factory.mktemp("compared")
    return folder / "store", made_comparison.run(folder / "inputs", folder / "store")


def _pipeline(target: str, source: Path, store: Path) -> str:
    command = [sys.executable, "pipeline.py", "run", target, "--source", source, "--store", store, "--jobs", "1", "--json"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout
