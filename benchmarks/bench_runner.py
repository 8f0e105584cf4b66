"""Measure the overhead of the runner compared with doit and joblib: N shards through three stages of 10 kB each.

    python benchmarks/bench_runner.py [--shards 1000] [--peers PYTHON_WITH_DOIT_AND_JOBLIB]

Times are CPU seconds of the whole process tree (user + system) with interpreter start and imports; the best of three for cached
runs. Writes benchmarks/runner.md.
"""

from __future__ import annotations

import argparse
import os
import platform
import resource
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
STAGE = '''
from __future__ import annotations
from blob import Blob
FACTOR = {factor}
def run(blob: Blob) -> Blob:
    return Blob(blob.name, bytes((byte * FACTOR + {salt}) % 256 for byte in blob.data[:64]) + blob.data[64:])
'''
BLOB = '''
from __future__ import annotations
import hashlib
from dataclasses import dataclass
@dataclass(frozen=True)
class Blob:
    name: str
    data: bytes
class Codec:
    def children(self, value): return [(v.name, v) for v in value] if isinstance(value, tuple) else None
    def combine(self, kind, children): return tuple(value for _, value in children)
    def kind(self, value): return type(value).__name__
    def digest(self, value): return hashlib.sha256(value.name.encode() + b"\\0" + value.data).hexdigest()
    def save(self, value, folder):
        (folder / "name").write_text(value.name)
        (folder / "data").write_bytes(value.data)
    def load(self, kind, files): return Blob(files["name"].read_text(), files["data"].read_bytes())
    def schema_version(self, kind): return ""
CODEC = Codec()
'''
OURS = '''
import sys
from pathlib import Path
sys.path[:0] = [{root!r}, "."]
import a, b, c
from blob import Blob
from runner import Graph, Runner
g = Graph()
blob = g.each(g.leaf("in", tuple(Blob(f"s{{i}}", i.to_bytes(4, "big") * 2500) for i in range({shards}))))
for stage in (a, b, c):
    blob = g.add(stage.run, blob=blob)
g.target("all", blob)
report = Runner(Path("store"), Path("."), "blob:CODEC", None, jobs={jobs}).run(g, "all")
sys.stdout.write("/".join(str(report.ran.get(stage, 0)) for stage in "abc"))
'''
PLAIN = "def work(data, salt):\n    return bytes((byte * 3 + salt) % 256 for byte in data[:64]) + data[64:]\n"
DOIT = PLAIN + '''
from pathlib import Path
def make(source, target, salt): Path(target).write_bytes(work(Path(source).read_bytes(), salt))
for name in ("in", "a", "b", "c"): Path(name).mkdir(exist_ok=True)
for i in range({shards}):
    if not Path(f"in/{{i}}").exists(): Path(f"in/{{i}}").write_bytes(i.to_bytes(4, "big") * 2500)
def task_all():
    for salt, (before, after) in enumerate((("in", "a"), ("a", "b"), ("b", "c"))):
        for i in range({shards}):
            yield {{"name": f"{{after}}{{i}}", "actions": [(make, [f"{{before}}/{{i}}", f"{{after}}/{{i}}", salt])],
                   "file_dep": [f"{{before}}/{{i}}"], "targets": [f"{{after}}/{{i}}"]}}
'''
JOBLIB = '''
import joblib
memory = joblib.Memory("cache", verbose=0)
''' + PLAIN + '''
work = memory.cache(work)
for i in range({shards}):
    data = i.to_bytes(4, "big") * 2500
    for salt in range(3):
        data = work(data, salt)
'''
PEERS = (("doit", "dodo.py", DOIT, ["-m", "doit", "-v0"]), ("joblib.Memory", "run.py", JOBLIB, ["run.py"]))


def cpu(command: list[str], folder: Path) -> tuple[float, str]:
    """(CPU seconds, what it printed) of a process and all it has started."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, done.stdout


def write_ours(folder: Path, shards: int, jobs: int, *, factor: int = 3, comment: str = "") -> None:
    """Write the project of stages for our runner."""
    (folder / "blob.py").write_text(BLOB)
    for salt, name in enumerate("abc"):
        (folder / f"{name}.py").write_text(STAGE.format(factor=factor if name == "b" else 3, salt=salt) + comment)
    (folder / "main.py").write_text(OURS.format(root=str(ROOT), shards=shards, jobs=jobs))


def ours(shards: int) -> list[tuple[str, float, str]]:
    """Return (scenario, CPU seconds, stages run) of every scenario."""
    with tempfile.TemporaryDirectory() as name:
        folder, run = Path(name), [sys.executable, "main.py"]
        write_ours(folder, shards, 2)
        rows = [("cold, two workers", *cpu(run, folder)), ("nothing to do", *best(lambda: cpu(run, folder)))]
        write_ours(folder, shards, 2, comment="# a comment\n")
        rows.append(("a comment changed", *cpu(run, folder)))
        write_ours(folder, shards, 2, factor=259)
        rows.append(("a constant of b changed, same bytes", *cpu(run, folder)))
        write_ours(folder, shards, 2)
        rows.append(("undone", *cpu(run, folder)))
        write_ours(folder, shards + 1, 2)
        rows.append(("one shard more", *cpu(run, folder)))
        shutil.rmtree(folder / "store")
        write_ours(folder, shards, 0)
        rows.append(("cold, in one process", *cpu(run, folder)))
    return rows


def peer(python: str, shards: int, file: str, text: str, command: list[str]) -> tuple[float, float]:
    """(cold, nothing to do) in CPU seconds."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / file).write_text(text.format(shards=shards))
        return cpu([python, *command], folder)[0], best(lambda: cpu([python, *command], folder))[0]


def best(measure: Callable[[], tuple[float, str]]) -> tuple[float, str]:
    """The cheapest of three."""
    return min(measure() for _ in range(3))


def main() -> None:
    """Measure, then write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--shards", type=int, default=1000)
    parser.add_argument("--peers", help="a Python that has doit and joblib")
    chosen = parser.parse_args()
    start = best(lambda: cpu([sys.executable, "-c", "pass"], ROOT))[0]
    lines = [f"# The runner: {3 * chosen.shards} tasks of 10 kB", "",
             f"CPU seconds of the process tree, start-up included (a bare interpreter: {start:.3f}). {platform.machine()}, "
             f"{os.cpu_count()} cores, Python {platform.python_version()}. Written by `benchmarks/bench_runner.py`.", "",
             "| scenario | CPU s | tasks run in a/b/c |", "|---|--:|---|"]
    lines += [f"| {what} | {seconds:.2f} | {ran} |" for what, seconds, ran in ours(chosen.shards)]
    if chosen.peers:
        lines += ["", "| peer | cold | nothing to do |", "|---|--:|--:|"]
        for name, file, text, command in PEERS:
            cold, idle = peer(chosen.peers, chosen.shards, file, text, command)
            lines.append(f"| {name} | {cold:.2f} | {idle:.2f} |")
        lines += ["", "doit keeps no old outputs and loses its state when it is killed; joblib does not see a changed helper "
                  "or constant. Neither verifies what it reads."]
    (ROOT / "benchmarks" / "runner.md").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
