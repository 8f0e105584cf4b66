"""2: outputs under names that people find: published twice, by several processes at one moment, and after kills."""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from benchmarks.reliability.commands import Tiny
from benchmarks.reliability.rows import Plan, Row
from tests.helpers.flipped_stores import NoEndError, apart, last_line

AT_ONCE = 5
READER = '''
import os, sys
folder, stop = sys.argv[1:]
looks = absent = 0
while not os.path.exists(stop):
    looks += 1
    try:
        whole = bool(os.listdir(folder))
    except FileNotFoundError:
        whole = False
    absent += not whole
print(looks, absent)
'''


def rows(plan: Plan) -> list[Row]:
    """Test publication of the data set of a tiny source."""
    tiny = Tiny(plan.place("tiny")).write()
    wrong = tiny.run() + tiny.run()
    again = Row("run dataset twice: nothing hidden is left beside what is published")
    rooms = (tiny.store / "datasets", tiny.store / "recordings")
    hidden = sorted(path.name for room in rooms for path in room.rglob(".*") if path.name != ".clips")
    again.count(wrong + ([f"{len(hidden)} left: {', '.join(hidden[:3])}"] if hidden else []))
    if wrong:
        return [again]
    digests = apart(_digests, tiny, limit_s=120.0)
    return [again, _file_twice(plan, tiny, digests), *_at_once(plan, tiny, digests), _stale(plan, tiny, digests), _retired(plan)]


def _digests(tiny: Tiny) -> dict[str, str]:
    """Artifacts of a folder and of a file."""
    from commands.origin import origin
    from commands.session import digester, open_runner
    from maps.settings import Settings
    from pipeline import build

    runner, settings = open_runner(tiny.store, 0), Settings()
    place, _ = origin("dataset", tiny.source, settings, digester(runner), ())
    report = runner.run(build("dataset", place, settings), "dataset")
    return {"folder": report.outputs["dataset_pack"][0][1], "file": report.outputs["clip_record"][0][1]}


def _opened(tiny: Tiny) -> Any:
    from commands.session import open_runner

    return open_runner(tiny.store, 0)


def _file_twice(plan: Plan, tiny: Tiny, digests: dict[str, str]) -> Row:
    row = Row("publish_file of the same file twice: one name is there")
    for n in range(plan.times(6, 2)):
        folder = plan.place(f"twice-{n}")
        _count(row, _published_twice, tiny, digests["file"], folder / "clip.mcap")
    return row


def _published_twice(tiny: Tiny, digest: str, path: Path) -> list[str]:
    from commands.publish import publish_file

    runner = _opened(tiny)
    for _ in range(2):
        publish_file(runner, digest, path)
    there = sorted(found.name for found in path.parent.iterdir())
    return [] if there == [path.name] else [f"there are {', '.join(there)}"]


def _count(row: Row, work: Any, *args: Any) -> None:
    try:
        row.count(apart(work, *args))
    except (NoEndError, RuntimeError) as error:
        row.count([last_line(error)])


def _at_once(plan: Plan, tiny: Tiny, digests: dict[str, str]) -> list[Row]:
    """Processes that publish one folder, and one that looks at it."""
    row = Row(f"publish of one folder by {AT_ONCE} processes at one moment")
    seen = Row("a reader beside them finds the folder whole")
    folder, stop, each = plan.place("at-once") / "set", plan.folder / "stop", plan.times(400, 100)
    _count(Row(""), _publish, tiny, digests["folder"], folder)
    expected = {path.name for path in folder.iterdir()}
    reader = subprocess.Popen([sys.executable, "-c", READER, str(folder), str(stop)], stdout=subprocess.PIPE, text=True)
    context = multiprocessing.get_context("fork")
    with context.Pool(AT_ONCE) as pool:
        for wrong in pool.starmap(_many, [(tiny, digests["folder"], folder, each)] * AT_ONCE):
            for one in wrong:
                row.count(one)
    stop.touch()
    looks, absent = map(int, reader.communicate()[0].split())
    seen.tried, seen.held, seen.failures = looks, looks - absent, [f"absent {absent} times"] if absent else []
    left = sorted(path.name for path in folder.parent.iterdir() if path.name != "set")
    rest = Row("nothing is left beside it, and the folder is whole")
    rest.count(([f"{len(left)} left: {', '.join(left[:3])}"] if left else [])
               + ([] if folder.exists() and {path.name for path in folder.iterdir()} == expected else ["the folder is not whole"]))
    return [row, seen, rest]


def _publish(tiny: Tiny, digest: str, folder: Path) -> list[str]:
    from commands.publish import publish

    publish(_opened(tiny), digest, folder)
    return []


def _many(tiny: Tiny, digest: str, folder: Path, times: int) -> list[list[str]]:
    from commands.publish import publish

    runner, found = _opened(tiny), list[list[str]]()
    for _ in range(times):
        try:
            publish(runner, digest, folder)
            found.append([])
        except OSError as error:
            found.append([f"{type(error).__name__}: {error}"[:120]])
    return found


def _stale(plan: Plan, tiny: Tiny, digests: dict[str, str]) -> Row:
    row = Row("publish by a process with the number of one that was killed half-way: its files are not mixed in")
    for name in ("partial", "old"):
        _count(row, _published_over, tiny, digests["folder"], plan.place(f"stale-{name}") / "set", name)
    return row


def _published_over(tiny: Tiny, digest: str, folder: Path, name: str) -> list[str]:
    from commands.publish import publish

    runner = _opened(tiny)
    publish(runner, digest, folder)
    expected = {path.name for path in folder.iterdir()}
    left = folder.with_name(f".{folder.name}.{name}-{os.getpid()}")
    left.mkdir()
    (left / "stale.txt").write_text("of a run that was killed")
    publish(runner, digest, folder)
    found = {path.name for path in folder.iterdir()}
    return [] if found == expected else [f"found {', '.join(sorted(found ^ expected))}"]


def _retired(plan: Plan) -> Row:
    """See commands.publish.retire_recordings."""
    row, folder = Row("a tampered list of clips deletes nothing outside its folder"), plan.place("retired") / "set"
    folder.mkdir()
    (folder.parent / "mine.txt").write_text("mine")
    (folder / ".clips").write_text("../mine.txt\n")
    _count(row, _retire, folder)
    row.count([] if (folder.parent / "mine.txt").exists() else ["a file outside was deleted"])
    return row


def _retire(folder: Path) -> list[str]:
    from commands.publish import retire_recordings

    retire_recordings(folder, {"a.mcap"}, True)
    return []
