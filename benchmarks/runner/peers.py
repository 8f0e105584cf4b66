"""Peers that do the same work: N files of 10 kB through three stages, each in a virtual environment of its own."""

from __future__ import annotations

import subprocess
import venv
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from benchmarks.runner.measure import spent

WORK = '''import sys
from pathlib import Path


def work(data, salt):
    return bytes((byte * 3 + salt) % 256 for byte in data[:64]) + data[64:]


def make(source, target, salt):
    Path(target).write_bytes(work(Path(source).read_bytes(), salt))


if __name__ == "__main__":
    make(sys.argv[1], sys.argv[2], int(sys.argv[3]))
'''
DOIT = '''from work import make
STEPS = tuple(enumerate((("in", "a"), ("a", "b"), ("b", "c"))))
def task_all():
    for salt, (before, after) in STEPS:
        for i in range({shards}):
            yield {{"name": f"{{after}}{{i}}", "actions": [(make, [f"{{before}}/{{i}}", f"{{after}}/{{i}}", salt])],
                   "file_dep": [f"{{before}}/{{i}}", "work.py"], "targets": [f"{{after}}/{{i}}"]}}
'''
JOBLIB = '''from pathlib import Path
import joblib
from work import work
work = joblib.Memory("cache", verbose=0).cache(work)
for i in range({shards}):
    data = Path(f"in/{{i}}").read_bytes()
    for salt in range(3):
        data = work(data, salt)
'''
PYTASK = '''from pathlib import Path
from typing import Annotated
from pytask import Product, task
from work import make
STEPS = tuple(enumerate((("in", "a"), ("a", "b"), ("b", "c"))))
for salt, (before, after) in STEPS:
    for i in range({shards}):
        @task(id=f"{{after}}{{i}}")
        def task_make(source: Path = Path(f"{{before}}/{{i}}").absolute(), salt: int = salt,
                      helper: Path = Path("work.py").absolute(),
                      target: Annotated[Path, Product] = Path(f"{{after}}/{{i}}").absolute()) -> None:
            make(source, target, salt)
'''
SNAKEFILE = '''N = range({shards})
rule all:
    input: expand("c/{{i}}", i=N)
rule a:
    input: "in/{{i}}", "work.py"
    output: "a/{{i}}"
    shell: "{python} -S -E work.py {{input[0]}} {{output}} 0"
rule b:
    input: "a/{{i}}", "work.py"
    output: "b/{{i}}"
    shell: "{python} -S -E work.py {{input[0]}} {{output}} 1"
rule c:
    input: "b/{{i}}", "work.py"
    output: "c/{{i}}"
    shell: "{python} -S -E work.py {{input[0]}} {{output}} 2"
'''
REDUN = '''from redun import File, task
from work import make
redun_namespace = "bench"
@task()
def step(source: File, target: str, salt: int) -> File:
    make(source.path, target, salt)
    return File(target)
@task()
def main() -> list:
    return [step(step(step(File(f"in/{{i}}"), f"a/{{i}}", 0), f"b/{{i}}", 1), f"c/{{i}}", 2) for i in range({shards})]
'''
HAMILTON = '''from pathlib import Path
from hamilton import driver
import flow
runner = driver.Builder().with_modules(flow).with_cache(path="cache").build()
inputs = {{f"in_{{i}}": Path(f"in/{{i}}").read_bytes() for i in range({shards})}}
runner.execute([f"c_{{i}}" for i in range({shards})], inputs=inputs)
'''


@dataclass(frozen=True)
class Peer:
    """A peer: what is installed, the files of its project, and the command, in which {bin} is its folder of programs."""

    name: str
    requirement: str
    command: str
    files: Callable[[int, str], dict[str, str]]
    """(shards, its Python) -> text of each file"""
    kind: str = "functions"
    """how it runs a task: a call in its own process, or a process for each"""
    large: bool = True
    """fit for 1,000 shards within minutes"""


def _one(name: str, text: str) -> Callable[[int, str], dict[str, str]]:
    return lambda shards, python: {name: text.format(shards=shards, python=python)}


def _ninja(shards: int, python: str) -> dict[str, str]:
    lines = [f"rule make\n  command = {python} -S -E work.py $in $out $salt\n"]
    for salt, (before, after) in enumerate((("in", "a"), ("a", "b"), ("b", "c"))):
        lines += [f"build {after}/{i}: make {before}/{i} | work.py\n  salt = {salt}\n" for i in range(shards)]
    return {"build.ninja": "".join(lines)}


def _hamilton(shards: int, python: str) -> dict[str, str]:
    steps = tuple(enumerate((("in", "a"), ("a", "b"), ("b", "c"))))
    made = [f"def {after}_{i}({before}_{i}: bytes) -> bytes:\n    return work({before}_{i}, {salt})\n"
            for salt, (before, after) in steps for i in range(shards)]  # fmt: skip
    return {"flow.py": "from work import work\n" + "".join(made), "run.py": HAMILTON.format(shards=shards)}


PEERS = (
    Peer("doit", "doit==0.37.0", "{bin}/python -m doit -v0", _one("dodo.py", DOIT)),
    Peer("joblib.Memory", "joblib==1.6.0", "{bin}/python run.py", _one("run.py", JOBLIB)),
    Peer("ninja", "ninja==1.13.2", "{bin}/ninja --quiet", _ninja, "processes"),
    Peer("Hamilton", "sf-hamilton==1.90.0", "{bin}/python run.py", _hamilton, large=False),
    Peer("pytask", "pytask==0.6.0", "{bin}/pytask --verbose 0", _one("task_all.py", PYTASK), large=False),
    Peer("Snakemake", "snakemake==9.27.1", "{bin}/snakemake --cores 2 --quiet all", _one("Snakefile", SNAKEFILE), "processes",
         large=False),
    Peer("redun", "redun==0.44.1", "{bin}/redun run flow.py main", _one("flow.py", REDUN), large=False))  # fmt: skip


@dataclass(frozen=True)
class Project:
    """Project of a peer in a folder."""

    peer: Peer
    folder: Path
    bin: Path

    def write(self, shards: int) -> Project:
        """Write its files and inputs."""
        for name in ("in", "a", "b", "c"):
            (self.folder / name).mkdir(parents=True)
        for i in range(shards):
            (self.folder / "in" / str(i)).write_bytes(i.to_bytes(4, "big") * 2500)
        for name, text in ({"work.py": WORK} | self.peer.files(shards, str(self.bin / "python"))).items():
            (self.folder / name).write_text(text)
        return self

    def cpu_s(self) -> float:
        """CPU seconds of its command."""
        command = self.peer.command.format(bin=self.bin).split()
        quiet = {"DO_NOT_TRACK": "1", "HAMILTON_TELEMETRY_ENABLED": "false"}
        return spent(command, self.folder, PATH=f"{self.bin}:/usr/bin:/bin", PYTHONPATH=str(self.folder), **quiet).cpu_s


def installed(peer: Peer, venvs: Path) -> tuple[Path | None, str]:
    """(folder of its programs, '') of a peer; (None, the reason) when it cannot be installed."""
    home = venvs / peer.requirement.replace("==", "-")
    if not (home / "installed").exists():
        venv.create(home, with_pip=True, clear=True)
        command = [str(home / "bin" / "python"), "-m", "pip", "install", "-q", "--disable-pip-version-check", peer.requirement]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            return None, f"left out, pip could not install it: {done.stderr.strip().splitlines()[-1][:200]}"
        (home / "installed").touch()
    return home / "bin", ""
