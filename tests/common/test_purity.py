"""Purity of stages: run again elsewhere, later and under watch, a stage gives the same bytes and opens no other file."""

from __future__ import annotations

import importlib
import inspect
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from afford.codecs import CODEC
from afford.common.kernel_cache import LOCATOR
from afford.common.worker import FONT_FOLDER
from runner import RunReport
from runner.fingerprint import fingerprint
from runner.index import Index, Trace
from runner.modules import Modules
from runner.store import Store, prepare_store
from tests.helpers import impure_stages, landlock
from tests.helpers.command import Made
from tests.helpers.fonts import with_fonts
from tests.helpers.impure_stages import CHEATS
from tests.helpers.kernels import KERNELS
from tests.helpers.purity_probe import blobs
from tests.helpers.purity_stores import ELSEWHERE, Maker
from tests.helpers.shared import shared
from tests.helpers.stage_files import MODULES

ROOT = Path(__file__).resolve().parents[2]
STAGES = sorted(MODULES)
OTHER_ENVIRONMENT = {
    "HOME": "/nonexistent", "USER": "other", "TZ": "Pacific/Chatham", "LANG": "C", "LC_ALL": "C", "PYTHONUTF8": "0",
    "PYTHONCOERCECLOCALE": "0", "PYTHONHASHSEED": "4711", "PYTHONDONTWRITEBYTECODE": "1", "COLUMNS": "40",
    "OPENBLAS_NUM_THREADS": "3", "OMP_WAIT_POLICY": "PASSIVE", "SOURCE_DATE_EPOCH": "1", "MPLBACKEND": "svg"}  # fmt: skip
KERNEL_CACHE = [str(ROOT / "afford" / "common" / name) for name in ("kernel_cache.py", "kernel_locator.py")]
"""files of the project that numba imports to find compiled kernels; they decide no bytes"""
MACHINE_KIND = ("OPENBLAS_CORETYPE",)
"""selects the vector units of linear algebra; bytes are promised for one kind of machine only"""
COMPARED = ("predict_cases", "baseline_cases", "score_cases", "benchmark")
"""stages whose store is the fixture `compared`"""
OTHER_STYLE = "figure.dpi: 33\nlines.linewidth: 9\nsavefig.facecolor: red\nimage.cmap: gray\n"


class Server:
    """A process of `tests/helpers/purity_probe.py` in an environment, which loads `modules` before its first job."""

    def __init__(self, environment: Mapping[str, str], *modules: str) -> None:
        command = [sys.executable, str(ROOT / "tests" / "helpers" / "purity_probe.py"), *modules]
        environment = {**environment, **LOCATOR, "NUMBA_CACHE_DIR": str(KERNELS)}  # numba reads them when it is loaded
        self._process = subprocess.Popen(command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def do(self, folder: Path, store: Path, **job: Any) -> Path:
        """Do a job with the fonts of a store, and return its answer."""
        environment = {"MPLCONFIGDIR": str(store / ".cache" / FONT_FOLDER)}
        (folder / "job.json").write_text(json.dumps({"root": str(ROOT), "store": str(store), "environment": environment, **job}))
        assert self._process.stdin and self._process.stdout
        print(folder / "job.json", file=self._process.stdin, flush=True)
        code = int(self._process.stdout.readline())
        assert code == 0, (folder / "error.txt").read_text()
        return folder / "answer.json"

    def close(self) -> None:
        """End the process."""
        self._process.communicate()


@pytest.fixture(scope="module")
def modules() -> Modules:
    """Modules of the project, parsed once."""
    return Modules(ROOT)


@pytest.fixture(scope="module")
def probe() -> Iterator[Server]:
    """The server that replays stages, in another environment than that of the first run."""
    server = Server(OTHER_ENVIRONMENT | {name: os.environ[name] for name in MACHINE_KIND if name in os.environ})
    yield server
    server.close()


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[Maker], Path]]:
    """The store that a maker fills when it is first needed."""
    server = Server(os.environ, "tests.helpers.purity_stores")

    def store(maker: Maker) -> Path:
        def fill(folder: Path) -> None:
            (folder / "store").mkdir()
            (folder / "files").mkdir()
            server.do(folder, folder / "store", maker=maker.__name__, files=str(folder / "files"))

        return shared(tmp_path_factory, maker.__name__, fill) / "store"

    yield store
    server.close()


@pytest.fixture(scope="module")
def benchmarked(compared: tuple[Path, RunReport]) -> Path:
    """A store with a comparison of methods."""
    return with_fonts(compared[0])


@pytest.mark.parametrize("stage", STAGES)
def test_stage_is_pure(stage: str, made: Made, filled: Callable[[Maker], Path], probe: Server, modules: Modules,
                       request: pytest.FixtureRequest, tmp_path: Path) -> None:  # fmt: skip
    """Replay a stage with another working directory, environment, clock, hash seed and random state, and read-only inputs.

    It gives the same bytes, opens no undeclared file, starts no process, opens no connection and prints nothing.
    """
    store = filled(ELSEWHERE[stage]) if stage in ELSEWHERE else made.store
    if stage in COMPARED:
        store = request.getfixturevalue("benchmarked")
    traces = one_of_each(Index(store).all(), f"{MODULES[stage]}:run")
    assert traces, f"no run of stages/{stage}.py to repeat: add it to a target of the tiny source"
    answers = replay(probe, list(map(task, traces)), sources(traces, modules), store, tmp_path)
    for trace, answer in zip(traces, answers, strict=True):
        assert not answer["problems"], "\n".join([trace.stage, *answer["problems"]])
        before = blobs(Store(store, CODEC), trace.output)
        other = [name for (name, blob), (_, again) in zip(before, answer["blobs"], strict=False) if blob != again]
        assert answer["output"] == trace.output, f"{trace.stage} of shard {trace.shard!r}: another output, differs in {other}"
        assert answer["blobs"] == before, f"{trace.stage}: the same value in other bytes, {other}"


def one_of_each(traces: Iterable[Trace], function: str) -> list[Trace]:
    """One run of every node of the graph that calls the function."""
    mine = sorted((trace for trace in traces if trace.function == function), key=lambda trace: trace.shard)
    return list({trace.stage: trace for trace in mine}.values())


def test_impure_stages_are_detected(made: Made, probe: Server, tmp_path: Path) -> None:
    """Each impure stage gives another output or is reported. Files that libraries open are seen with Landlock only."""
    prepare_store(tmp_path / "store")
    store = Store(tmp_path / "store", CODEC)
    trace = next(trace for trace in Index(made.store).all() if trace.stage == "key_thin")
    clip = Store(made.store, CODEC).load(trace.inputs["clip"])
    given = {"clip": store.put_leaf(clip)}
    functions = [f"tests.helpers.impure_stages:{cheat.__name__}" for cheat in CHEATS]
    tasks = [task(replace(trace, function=function, inputs=given)) | {"params": {}} for function in functions]
    before = [store.put_leaf(cheat(deepcopy(clip), impure_stages.Params())) for cheat in CHEATS]
    answers = replay(probe, tasks, [impure_stages.__file__], store.root, tmp_path)
    unseen = [cheat.__name__ for cheat, answer, output in zip(CHEATS, answers, before, strict=True)
              if not answer["problems"] and answer["output"] == output]
    assert unseen == ([] if landlock.available() else ["file_behind_python"])


def replay(probe: Server, tasks: list[dict[str, Any]], allowed: list[str], store: Path, folder: Path) -> list[dict[str, Any]]:
    """Run tasks again in one fresh process, which may open the files of the project that are `allowed`."""
    work, elsewhere = folder / "work", folder / "elsewhere"
    work.mkdir()
    elsewhere.mkdir()
    (elsewhere / "matplotlibrc").write_text(OTHER_STYLE)
    found = probe.do(folder, store, work=str(work), elsewhere=str(elsewhere), sources=allowed, tasks=tasks,
                     models=[model for task in tasks for model in models(task["params"])])  # fmt: skip
    answers: list[dict[str, Any]] = json.loads(found.read_text())
    return answers


def models(params: dict[str, Any]) -> list[str]:
    """Weights that parameters name, those of a block too."""
    blocks = [value["fields"] for value in params.values() if isinstance(value, dict) and "fields" in value]
    return [model for model in (params.get("model"), *(model for block in blocks for model in models(block))) if model]


def task(trace: Trace) -> dict[str, Any]:
    """Description of a run for the probe."""
    module, _, name = trace.function.partition(":")
    wants_ctx = "ctx" in inspect.signature(getattr(importlib.import_module(module), name)).parameters
    return {"function": trace.function, "params": trace.params["fields"], "inputs": trace.inputs, "threads": trace.threads,
            "wants_ctx": wants_ctx}


def sources(traces: list[Trace], modules: Modules) -> list[str]:
    """The files of the project that the key of a stage is taken over: its own, the codec's, those of the worker's hook."""
    found = [fingerprint(modules, trace.function, trace.params["fields"]).files for trace in traces]
    found += [fingerprint(modules, "afford.common.worker:prepare", {}).files,
              fingerprint(modules, "afford.codecs:CODEC", {}, excluded=modules.schemas).files]  # fmt: skip
    return sorted({path for paths in found for path in paths} | set(KERNEL_CACHE))
