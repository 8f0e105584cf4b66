"""Measure what Ray adds to a task: shards of empty work, inline and on a private cluster of this machine.

    PYTHONPATH=. python benchmarks/runner/bench_ray.py [--quick]

CPU seconds, user and system, of the whole process tree. Ray's services, its workers and the stage processes are read from /proc
right before the cluster ends, the driver at its own end. Start-up is apart: a run of one shard is subtracted from each. Inline and
Ray runs alternate, and the medians count. Needs the extra `ray`. Details are in ray.md, beside the page of all parts.
"""

from __future__ import annotations

import json
import platform
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.runner.parts import HERE, Plan, Row, measure

ROOT = Path(__file__).resolve().parent.parent.parent
STAGE = '''
from __future__ import annotations
from blob import Blob
def run(blob: Blob) -> Blob:
    return blob
'''
BLOB = '''
from __future__ import annotations
import hashlib
from dataclasses import dataclass
@dataclass(frozen=True)
class Blob:
    name: str
class Codec:
    def children(self, value): return [(v.name, v) for v in value] if isinstance(value, tuple) else None
    def combine(self, kind, children): return tuple(value for _, value in children)
    def kind(self, value): return type(value).__name__
    def digest(self, value): return hashlib.sha256(value.name.encode()).hexdigest()
    def save(self, value, folder): (folder / "name").write_text(value.name)
    def load(self, kind, files): return Blob(files["name"].read_text())
    def schema_version(self, kind): return ""
CODEC = Codec()
'''
MAIN = '''
import json, os, resource, sys, time
from functools import partial
from pathlib import Path
sys.path[:0] = [{root!r}, "."]
import empty
from blob import Blob
from runner import Graph, Runner
from runner.engines import Inline
from runner.ray_engine import RayEngine

shards, engine = int(sys.argv[1]), sys.argv[2]
TICKS = os.sysconf("SC_CLK_TCK")
found = {{"services": 0.0, "ray workers": 0.0, "stage processes": 0.0}}

def kind(pid):
    command = Path("/proc", pid, "cmdline").read_bytes().decode(errors="replace")
    if "runner.ray_child" in command:
        return "stage processes"
    return "ray workers" if command.startswith(("ray::batch", "ray::IDLE")) else "services"

def count():
    """Add the CPU seconds of every process that this one has started, directly or not."""
    rows = {{}}
    for pid in filter(str.isdigit, os.listdir("/proc")):
        try:
            fields = Path("/proc", pid, "stat").read_text().rpartition(")")[2].split()
            rows[pid] = fields[1], sum(map(int, fields[11:15])) / TICKS, kind(pid)
        except OSError:
            continue  # it has ended
    inside = {{str(os.getpid())}}
    while more := {{pid for pid, (parent, _, _) in rows.items() if parent in inside}} - inside:
        inside |= more
    for pid in inside - {{str(os.getpid())}}:
        found[rows[pid][2]] += rows[pid][1]

class Measured(RayEngine):
    def close(self):
        count()
        super().close()

g = Graph()
g.target("all", g.add(empty.run, blob=g.each(g.leaf("in", tuple(Blob(f"s{{i}}") for i in range(shards))))))
began = time.monotonic()
kinds = {{"inline": dict(jobs=0, engine=Inline), "ray": dict(jobs=2, engine=partial(Measured, jobs=2))}}
report = Runner(Path("store"), Path("."), "blob:CODEC", None, **kinds[engine]).run(g, "all")
assert report.ran == {{"empty": shards}}, report.failures[:3]
own = resource.getrusage(resource.RUSAGE_SELF)
found |= {{"driver": own.ru_utime + own.ru_stime, "wall": time.monotonic() - began, "peak": own.ru_maxrss / 1024}}
print(json.dumps(found))
'''
MEMORY = Path("/dev/shm")
"""file system in memory for the store, so that the disk does not count"""
PARTS = ("driver", "ray workers", "services", "stage processes")


def measured(shards: int, engine: str) -> dict[str, float]:
    """CPU seconds by kind of process, wall seconds and peak MiB of the driver, of one run in a new store."""
    with tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None) as name:
        folder = Path(name)
        for file, content in (("blob.py", BLOB), ("empty.py", STAGE), ("main.py", MAIN.format(root=str(ROOT)))):
            (folder / file).write_text(content)
        command = [sys.executable, "main.py", str(shards), engine]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        if done.returncode:
            raise SystemExit(done.stderr)
        found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
        return found


def median(runs: list[dict[str, float]]) -> dict[str, float]:
    """Median of each figure."""
    return {name: statistics.median(run[name] for run in runs) for name in runs[0]}


def cpu(run: dict[str, float]) -> float:
    """CPU seconds of all processes."""
    return sum(run[part] for part in PARTS)


def per_shard(run: dict[str, float], start: dict[str, float], shards: int) -> dict[str, float]:
    """Microseconds per shard by kind of process, without start-up."""
    return {part: 1e6 * (run[part] - start[part]) / shards for part in PARTS}


GOAL_US = 100


def rows(plan: Plan) -> list[Row]:
    """Measure, write ray.md, and return the rows of the page of all parts."""
    shards, many, pairs = (30, 60, 1) if plan.quick else (10_000, 100_000, 3)
    text, beside, large = page(shards, many, pairs)
    (HERE / "ray.md").write_text(text, encoding="utf-8")
    return [Row(f"Ray minus inline, {shards:,} empty shards, start-up apart, a shard", f"{GOAL_US} us CPU (aim 60)",
                f"{beside:.0f} us", beside <= GOAL_US, {"us": beside}, "store in memory"),
            Row(f"{many:,} empty shards on Ray", "", f"driver {large['driver']:.1f} s, {large['peak']:.0f} MiB; all processes "
                f"{cpu(large):.1f} s", None, {"driver_s": large["driver"], "driver_mib": large["peak"], "cpu_s": cpu(large)},
                "store in memory")]  # fmt: skip


def page(shards: int, many: int, pairs: int) -> tuple[str, float, dict[str, float]]:
    """Measure; return the page, what Ray adds to a shard (us), and the figures of the large run."""
    start = {engine: median([measured(1, engine) for _ in range(pairs)]) for engine in ("inline", "ray")}
    runs: dict[str, list[dict[str, float]]] = {"inline": [], "ray": []}
    for _ in range(pairs):
        for engine, found in runs.items():
            found.append(measured(shards, engine))
    inline, ray = median(runs["inline"]), median(runs["ray"])
    one, two = per_shard(inline, start["inline"], shards), per_shard(ray, start["ray"], shards)
    large = measured(many, "ray")
    table = [f"| {part} | {one[part]:.0f} | {two[part]:.0f} |" for part in PARTS]
    table.append(f"| together | {sum(one.values()):.0f} | {sum(two.values()):.0f} |")
    beside = two["driver"] + two["ray workers"] + two["services"] + two["stage processes"] - sum(one.values())
    lines = [
        "# Ray: shards of empty work", "",
        "One stage that returns its input, a file of a few bytes a shard, in a store in memory. A private cluster of this machine, "
        f"two stage processes. CPU, user and system, of the whole process tree. Median of {pairs} alternating pairs. "
        f"{platform.machine()}, Python {platform.python_version()}. Written by `benchmarks/runner/bench_ray.py`.", "",
        f"## Microseconds of CPU a shard, {shards:,} shards, start-up apart", "",
        "| process | inline | Ray |", "|---|--:|--:|", *table, "",
        f"Ray minus inline: **{beside:.0f} us** a shard. Inline, the driver executes the stages itself. Ray's services use CPU "
        "while they idle, in proportion to the wall time, and so they weigh most on a busy machine.", "",
        f"Start-up (a run of one shard): {cpu(start['inline']):.2f} CPU s inline, {cpu(start['ray']):.2f} on Ray.", ""]
    lines += [
        f"## {many:,} shards on Ray", "", "| what | value |", "|---|--:|",
        f"| driver: CPU | {large['driver']:.1f} s |", f"| driver: peak memory | {large['peak']:.0f} MiB |",
        f"| driver: CPU a shard | {1e6 * (large['driver'] - start['ray']['driver']) / many:.0f} us |",
        f"| all processes: CPU | {cpu(large):.1f} s |", f"| wall, two stage processes | {large['wall']:.0f} s |", ""]
    return "\n".join(lines), beside, large


if __name__ == "__main__":
    sys.exit(measure("ray", rows, __doc__))
