"""1f: stores and code that are moved, copied or given other times cost nothing; a changed constant is always seen."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

from benchmarks.reliability import toy
from benchmarks.reliability.rows import Plan, Row
from tests.helpers.flipped_stores import FlippedStore


def rows(plan: Plan) -> list[Row]:
    """Each way on a store of its own."""
    built = FlippedStore(plan.place("built"), toy.WIDE).write()
    first = toy.wrong_end(built, toy.run(built))
    ways: dict[str, Callable[[FlippedStore, Path], FlippedStore]] = {
        "project and store moved": _moved, "project and store copied (cp -r)": _copied,
        "store moved beside code at another path": _other_code, "all mtimes 1990": lambda project, _: _dated(project, 1990),
        "all mtimes 2100": lambda project, _: _dated(project, 2100)}
    found = []
    for n, (what, way) in enumerate(ways.items()):
        row, project = Row(f"{what}: nothing runs again"), FlippedStore(plan.folder / f"way-{n}", toy.WIDE)
        shutil.copytree(built.folder, project.folder)
        there = way(project, plan.folder / f"there-{n}")
        toy.executions(there)
        wrong = first + toy.wrong_end(there, toy.run(there))
        again = toy.executions(there)
        row.count(wrong + ([f"{again} of {there.tasks} tasks ran again"] if again else []))
        found.append(row)
    return [*found, _silent_edit(built)]


def _moved(project: FlippedStore, there: Path) -> FlippedStore:
    project.folder.rename(there)
    return FlippedStore(there, project.words)


def _copied(project: FlippedStore, there: Path) -> FlippedStore:
    shutil.copytree(project.folder, there, copy_function=shutil.copyfile)
    return FlippedStore(there, project.words)


def _other_code(project: FlippedStore, there: Path) -> FlippedStore:
    other = FlippedStore(there, project.words).write()
    project.store.rename(other.store)
    return other


def _dated(project: FlippedStore, year: int) -> FlippedStore:
    at = datetime(year, 1, 1, tzinfo=UTC).timestamp()
    for path in (project.folder, *project.folder.rglob("*")):
        os.utime(path, (at, at), follow_symlinks=False)
    return project


def _silent_edit(project: FlippedStore) -> Row:
    """Edit a file in place, with the same size and the modification time set back."""
    row, path = Row("a constant of a helper edited, same size, mtime and inode kept"), project.code / "toy" / "helper.py"
    before = path.stat()
    project.edit("?")
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    row.count(toy.wrong_end(project, toy.run(project), "?"))
    return row
