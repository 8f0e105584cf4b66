"""Fixtures of several test files: stores that are filled once in a test run."""

from __future__ import annotations

import gc
import json
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import cv2
import pytest

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # before torch loads OpenMP, whose threads would wait in a busy loop otherwise

import torch
from threadpoolctl import threadpool_limits

from commands import session
from commands.targets import use
from pipeline import TARGETS, build
from runner import RunReport
from tests.helpers import kernels
from tests.helpers.command import Made, call
from tests.helpers.fonts import with_fonts
from tests.helpers.shared import shared
from tests.helpers.tiny_source import write_source

cv2.ipp.setUseIPP(False)  # as in workers, so that a stage called here gives their bytes (tests/runner/test_worker.py)
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it, and so would what tests start

use(TARGETS, build)  # as the command line does, for tests that call its parts

ROOT = Path(__file__).resolve().parent.parent


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Collect no garbage while the tests are imported, and never look at what they imported again."""
    gc.disable()
    yield
    gc.freeze()
    gc.enable()


@pytest.fixture(scope="session", autouse=True)
def shared_kernels() -> Iterator[None]:
    """Share compiled kernels among the stores of all commands that run in this process."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(session, "use_kernel_cache", kernels.use_shared_kernels)
        yield


@pytest.fixture(scope="session", autouse=True)
def one_thread() -> None:
    """Compute on one thread in each worker of pytest, since the workers share the cores."""
    torch.set_num_threads(1)
    threadpool_limits(1)


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """Targets of a tiny source, built as by a user. Tests that change anything use `made.copy(tmp_path)`."""

    def fill(folder: Path) -> None:
        source = write_source(folder / "tiny", truth=True)
        runs = [call("run", target, "--source", source, "--store", folder / "store", "--jobs", "0", "--json")
                for target in ("dataset", "extraction-report")]  # fmt: skip
        assert all(run.code == 0 for run in runs), [run.err for run in runs]
        kernels.copy_kernels(folder / "store")
        with_fonts(folder / "store")
        (folder / "first.json").write_text(runs[0].out.splitlines()[-1])

    folder = shared(tmp_path_factory, "made", fill)
    return Made(folder / "tiny", folder / "store", json.loads((folder / "first.json").read_text()))


@pytest.fixture(scope="session")
def compared(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, RunReport]:
    """A store with a comparison of a tiny model, the baselines and another method, and the report of its run."""
    from tests.helpers import made_comparison

    def fill(folder: Path) -> None:
        assert made_comparison.run(folder / "inputs", folder / "store").ok

    store = shared(tmp_path_factory, "compared", fill) / "store"
    return store, made_comparison.run(tmp_path_factory.mktemp("compared"), store)
