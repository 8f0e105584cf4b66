"""Flip one bit in every kind of file of a finished store, and of a remote, the modification time kept; then verify and run.

    PYTHONPATH=. python benchmarks/runner/bench_flips.py [--quick]

Kinds are the folders of the store, whatever its format. A flip in a cache needs no report; one in any other file that is in use
must be reported by `verify`, or be harmless. After the next run, the outputs are those of a clean build and `verify` is content.
"""

from __future__ import annotations

import inspect
import os
import random
import shutil
import sys
from pathlib import Path

from benchmarks.runner import processes
from benchmarks.runner.parts import Plan, Row, measure
from benchmarks.runner.project import Project
from runner import Runner

SHARDS, FLIPS, SEED = 6, 8, 1
REPORTED = ("blobs", "manifests", "traces")
"""kinds in which verify must see a flip"""
IDLE = ("leases", "scratch", "damaged")


def rows(plan: Plan) -> list[Row]:
    """One row for the store, one for the remote."""
    made = [_row("store", _tried(plan, Project(plan.place("flips"), SHARDS, words=25).write(), ""))]
    what = "every kind of flip, remote"
    if "remote" not in inspect.signature(Runner).parameters:
        return [*made, Row(what, "found, healed", "Runner has no remote here")]
    remote = plan.place("remote")
    project = Project(plan.place("near"), SHARDS, words=25, remote=str(remote)).write()
    return [*made, _row("remote", _tried(plan, project, str(remote)))]


def _row(where: str, faults: dict[str, list[str]]) -> Row:
    """Counts by kind, and the first faults in words."""
    bad = {kind: [fault for fault in found if fault] for kind, found in faults.items()}
    tried, failed = sum(map(len, faults.values())), sum(map(len, bad.values()))
    kinds = ", ".join(f"{kind} {len(found) - len(bad[kind])}/{len(found)}" for kind, found in faults.items())
    note = "; ".join(f"{kind}: {fault}" for kind, found in bad.items() for fault in found[:2])
    return Row(f"every kind of flip, {where}", "found, healed", f"{tried - failed} of {tried} ({kinds})", not failed,
               {"tried": tried, "failed": failed}, note)  # fmt: skip


def _tried(plan: Plan, project: Project, remote: str) -> dict[str, list[str]]:
    """Map each kind of file to a fault for every flip, '' where the law held."""
    log, reported = plan.folder / "log", plan.folder / "reported"
    for _ in range(2):
        clean = processes.run(project, log, reported).found["outputs"]
    held = Path(remote) if remote else project.folder / project.store
    kept, chance = plan.folder / f"kept-{bool(remote)}", random.Random(SEED)
    shutil.copytree(held, kept, symlinks=True)
    found: dict[str, list[str]] = {}
    for kind, paths in sorted(_kinds(kept).items()):
        for _ in range(1 if plan.quick else FLIPS):
            _restore(kept, held, project, remote)
            change = _flip(held / chance.choice(paths), chance)
            found.setdefault(kind, []).append(_fault(project, kind, change, clean, bool(remote), log, reported))
    return found


def _kinds(kept: Path) -> dict[str, list[Path]]:
    """Files by kind: the first folder, and for caches the file."""
    kinds: dict[str, list[Path]] = {}
    for path in sorted(kept.rglob("*")):
        near = path.relative_to(kept)
        if path.is_file() and path.stat().st_size and near.parts[0] not in IDLE:
            kinds.setdefault("/".join(near.parts[:2]) if near.parts[0] == ".cache" else near.parts[0], []).append(near)
    return kinds


def _restore(kept: Path, held: Path, project: Project, remote: str) -> None:
    """Put the store or the remote back; with a remote, the store is empty, as on a new host."""
    shutil.rmtree(held)
    shutil.copytree(kept, held, symlinks=True)
    if remote:
        project.forget()


def _flip(path: Path, chance: random.Random) -> str:
    """Flip one bit, and keep the modification time."""
    before, data = path.stat(), bytearray(path.read_bytes())
    at = chance.randrange(len(data))
    data[at] ^= 1 << chance.randrange(8)
    path.chmod(0o644)
    path.write_bytes(data)
    path.chmod(before.st_mode & 0o7777)
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    return f"{path.name[:12]} byte {at}"


def _fault(project: Project, kind: str, change: str, clean: object, remote: bool, log: Path, reported: Path) -> str:
    """Verify, run, compare, verify; '' where the law held."""
    wrong = []
    if not remote and kind in REPORTED and project.call("verify")[1]["ok"]:
        wrong.append("verify reports nothing")
    ended = processes.run(project, log, reported)
    if ended.code:
        wrong.append(f"exit {ended.code}: {ended.messages[-150:]}")
    elif ended.found["outputs"] != clean:
        wrong.append("other outputs than a clean build")
    if not project.call("verify")[1]["ok"]:
        wrong.append("verify after the run is not content")
    return f"{change}: {', '.join(wrong)}" if wrong else ""


if __name__ == "__main__":
    sys.exit(measure("flips", rows, __doc__))
