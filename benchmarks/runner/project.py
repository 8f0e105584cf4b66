"""Project that the scripts of this folder run: N blobs through a chain of stages a, b, c, a, ..., which share a helper."""

from __future__ import annotations

import json
import shutil
import sys
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from benchmarks.runner.measure import Spent, spent

ROOT = Path(__file__).resolve().parents[2]
HELPERS = '''"""A helper that no stage declares."""


def rotate(data, factor, salt):
    return bytes((byte * factor + salt) % 256 for byte in data[:64]) + data[64:]
'''
STAGE = '''"""One blob to another: blob -> blob."""

from __future__ import annotations

import os

from blob import Blob
from {home} import rotate

FACTOR = {factor}


def run(blob: Blob) -> Blob:
    if "BENCH_LOG" in os.environ:
        with open(os.environ["BENCH_LOG"], "a") as stream:
            stream.write(f"{name} {{blob.name}}\\n")
    return Blob(blob.name, rotate(blob.data, FACTOR, {salt}))
'''
BLOB = '''"""A named blob, stored as one file, and its codec."""

from __future__ import annotations

from dataclasses import dataclass

from blake3 import blake3


@dataclass(frozen=True)
class Blob:
    name: str
    data: bytes


class Codec:
    def children(self, value):
        return [(one.name, one) for one in value] if isinstance(value, tuple) else None

    def combine(self, kind, children):
        return tuple(value for _, value in children)

    def kind(self, value):
        return "tuple" if isinstance(value, tuple) else "Blob"

    def digest(self, value):
        return blake3(value.name.encode() + b"\\n" + value.data).hexdigest()

    def save(self, value, folder):
        with open(f"{folder}/data", "wb") as stream:
            stream.write(value.name.encode() + b"\\n" + value.data)

    def load(self, kind, files):
        with open(files["data"], "rb") as stream:
            name, _, data = stream.read().partition(b"\\n")
        return Blob(name.decode(), data)

    def schema_version(self, kind):
        return "" if kind == "tuple" else "Blob 1"


CODEC = Codec()
'''
MAIN = '''"""Run one verb on the graph, and print what it did as JSON."""

import importlib
import inspect
import json
import sys
from pathlib import Path

ask = json.loads(sys.argv[1])
sys.path[:0] = [ask["root"], str(Path(__file__).parent)]

from blob import Blob
from runner import Graph, Runner

modules = [importlib.import_module(name) for name in ask["modules"]]
g = Graph()
blob = g.each(g.leaf("in", tuple(Blob(f"s{i}", (i + (ask["changed"] if i == 0 else 0)).to_bytes(4, "big") * ask["words"])
                                 for i in range(ask["shards"]))))
for i in range(ask["stages"]):
    blob = g.named("abc"[i % 3] + (str(i // 3) if i > 2 else "")).add(modules[i % 3].run, blob=blob)
g.target("all", blob)
more = {"remote": ask["remote"]} if ask["remote"] else {}
runner = Runner(Path(ask["store"]), Path(__file__).parent, "blob:CODEC", None, jobs=ask["jobs"], **more)


class Reported:
    """Writes every finished task to a log at once."""

    def __init__(self, path):
        self.stream = open(path, "a", buffering=1)

    def finished(self, stage, shard, result, wall_s, cpu_s, message):
        if result == "ran":
            self.stream.write(f"{stage} {shard}\\n")

    def __getattr__(self, name):
        return lambda *_: None


found = {}
if ask["verb"] == "run":
    report = runner.run(g, "all", observer=Reported(ask["reported"]) if ask["reported"] else None)
    found = {"ran": dict(report.ran), "cached": dict(report.cached), "failures": [one.message for one in report.failures],
             "outputs": report.outputs["all"] if "all" in report.outputs else next(iter(report.outputs.values()))}
elif ask["verb"] in ("plan", "explain"):
    plans = getattr(runner, ask["verb"])(g, "all")
    found = {"tasks": len(plans), "cached": [f"{one.stage} {one.shard}" for one in plans if one.status == "cached"]}
elif ask["verb"] == "stale":
    runner.stale(g, "all")
elif ask["verb"] == "verify":
    checked = runner.verify()
    found = {"ok": checked.ok, "bytes": checked.bytes}
elif ask["verb"] == "gc":
    runner.gc()
if ask["brief"]:
    found.pop("outputs", None)
    found.pop("cached", None)
with open("/proc/self/status") as lines:  # getrusage also counts the process that started this one
    found["peak_mib"] = next(int(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM"))
sys.stdout.write("\\n" + json.dumps(found) + "\\n")
if found.get("failures"):
    sys.exit("; ".join(found["failures"][:3]))
'''


@dataclass(frozen=True)
class Project:
    """Project in a folder, with its store; the fields are its size and the present state of its code and inputs."""

    folder: Path
    shards: int
    stages: int = 3
    words: int = 2500
    """length of each blob in words of 4 bytes"""
    jobs: int = 2
    factor: int = 3
    """constant of stage b; 259 gives the same bytes as 3"""
    comment: str = ""
    """comment at the end of stage b and of the helper"""
    moved: bool = False
    """stage b and the helper are in other modules"""
    changed: int = 0
    """nonzero: the first blob differs"""
    store: str = "store"
    remote: str = ""

    @property
    def tasks(self) -> int:
        """Number of tasks of the graph."""
        return self.shards * self.stages

    @property
    def modules(self) -> tuple[str, ...]:
        """Modules of the stages a, b and c."""
        return ("a", "elsewhere.second", "c") if self.moved else ("a", "b", "c")

    def write(self) -> Project:
        """Write the code, without what is there from a former state."""
        self.folder.mkdir(parents=True, exist_ok=True)
        for old in ("b.py", "helpers.py", "elsewhere/second.py", "elsewhere/shared.py"):
            (self.folder / old).unlink(missing_ok=True)
        home = "elsewhere.shared" if self.moved else "helpers"
        self._code(home, HELPERS + self.comment)
        for salt, module in enumerate(self.modules):
            factor = self.factor if salt == 1 else 3
            text = STAGE.format(name="abc"[salt], home=home, factor=factor, salt=salt)
            self._code(module, text + (self.comment if salt == 1 else ""))
        self._code("blob", BLOB)
        self._code("main", MAIN)
        return self

    def _code(self, module: str, text: str) -> None:
        """Write a module unless its text is there already; a file that is not touched keeps its time."""
        path = self.folder / f"{module.replace('.', '/')}.py"
        path.parent.mkdir(exist_ok=True)
        if not path.exists() or path.read_text() != text:
            path.write_text(text)

    def now(self, **changes: Any) -> Project:
        """Write the project in another state, in the same folder."""
        return replace(self, **changes).write()

    def command(self, verb: str, reported: str = "", brief: bool = True) -> list[str]:
        """Command line of a verb: run, plan, explain, stale, verify or gc.

        `reported`: file to which a run writes a line for every task that it reports as finished. `brief`: counts alone.
        """
        fields = {name: value for name, value in asdict(self).items() if name != "folder"}
        ask = fields | {"verb": verb, "modules": self.modules, "root": str(ROOT), "reported": reported, "brief": brief}
        return [sys.executable, str(self.folder / "main.py"), json.dumps(ask)]

    def call(self, verb: str, **environment: str) -> tuple[Spent, dict[str, Any]]:
        """Run a verb in its own process: what it used, and what it did."""
        done = spent(self.command(verb), self.folder, **environment)
        return done, answer(done.out)

    def cpu_s(self, verb: str) -> float:
        """CPU seconds of a verb."""
        return self.call(verb)[0].cpu_s

    def forget(self) -> None:
        """Delete the store."""
        shutil.rmtree(self.folder / self.store, ignore_errors=True)


def answer(out: str) -> dict[str, Any]:
    """Result of a verb: the last line that it printed."""
    found: dict[str, Any] = json.loads(out.strip().splitlines()[-1])
    return found


def ran(found: dict[str, Any]) -> str:
    """Executed tasks of a, b and c, as a/b/c."""
    return "/".join(str(found["ran"].get(stage, 0)) for stage in "abc")
