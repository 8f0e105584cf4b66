"""Past runs of a store, as their logs describe them: list, find by id, tasks of one run, delete old ones."""

from __future__ import annotations

import calendar
import os
import re
import time
from collections import defaultdict
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from runner.history import ENDS, HITS, PART, RUN, STARTS
from runner.lease import has_writer
from runner.log_file import BrokenLogError, LoggedMessage, is_finished, read_log
from runner.run_table import Keys, piece_path, read_table

KEEP, DAYS = 1000, 90.0
"""runs that gc keeps, and their age"""
DAY_S = 86400.0
NAME = re.compile(r"\.?(?P<time>\d{8}T\d{6}\.\d{3})Z-(?P<host>.*)-(?P<id>[0-9a-f]{8})\.mcap(?:\.part)?")
BEFORE = re.compile(r"last(?:~(\d+))?")


class UnknownRunError(ValueError):
    """No run, or more than one, has this id; the message says what to do."""


@dataclass(frozen=True)
class RunRecord:
    """Summary of a run."""

    id: str
    path: Path
    began: float
    """seconds since 1970"""
    outcome: str
    """ok, failed, stopped, error; running; ended early (its process was killed); damaged (its log)"""
    target: str = ""
    settings: dict[str, Any] = field(default_factory=dict)
    host: str = ""
    jobs: int = 0
    counts: dict[str, dict[str, int]] = field(default_factory=dict)
    """result -> stage -> number of tasks"""
    seconds: float = 0.0
    cpu_s: float = 0.0
    own_cpu_s: float = 0.0
    message: str = ""
    table: tuple[str, ...] | None = None
    """pieces of the table; None for a run that did not come to its end"""

    def count(self, result: str) -> int:
        """Number of tasks with this result."""
        return sum(self.counts.get(result, {}).values())

    def keys(self) -> Keys:
        """Table stage -> shard -> key.

        LostTableError when it is damaged; UnknownRunError when the run did not come to its end.
        """
        if self.table is None:
            raise UnknownRunError(f"run {self.id} has no table of its tasks ({self.outcome}); choose a run that came to its end")
        return read_table(self.path.parent, self.table)


class LoggedTask(NamedTuple):
    """One task of a run, with times in seconds since 1970."""

    stage: str
    shard: str
    result: str
    """ran, failed, blocked or deferred; running for a task without end"""
    start: float
    end: float
    cpu_s: float
    peak_mib: float
    reason: str
    message: str


def list_runs(store: Path, count: int | None = None) -> list[RunRecord]:
    """List the last `count` runs, or all, the newest first."""
    return [read_run(path) for path in run_paths(store)[:count]]


def run_paths(store: Path) -> list[Path]:
    """Logs of all runs, the newest first."""
    try:
        names = [name for name in os.listdir(store / "runs") if NAME.fullmatch(name)]
    except FileNotFoundError:
        return []
    return [store / "runs" / name for name in sorted(names, key=lambda name: name.lstrip("."), reverse=True)]


def find_run(store: Path, word: str) -> RunRecord:
    """Return the run with this id, a beginning of it, or `last`, `last~1`. UnknownRunError."""
    paths = run_paths(store)
    if not paths:
        raise UnknownRunError(f"{store} has no recorded run yet; record one with `run`")
    before = BEFORE.fullmatch(word)
    if before:
        back = int(before[1] or 0)
        if back >= len(paths):
            raise UnknownRunError(f"unknown run {word!r}; {store} has {len(paths)} recorded run(s), list them with `runs`")
        return read_run(paths[back])
    found = [path for path in paths if word and (_id(path).startswith(word) or path.name.lstrip(".").startswith(word))]
    if len(found) != 1:
        how = "is the beginning of more than one id; give more letters" if found else "is unknown; list the ids with `runs`"
        raise UnknownRunError(f"run {word!r} {how}")
    return read_run(found[0])


def read_run(path: Path) -> RunRecord:
    """Read the summary of one run, also of one that goes on or was killed."""
    if not path.exists():  # renamed since it was listed: it has ended
        path = path.with_name(path.name.lstrip(".").removesuffix(PART))
    going, began = path.name.startswith(".") and has_writer(path), _began(path)
    try:
        if not going and is_finished(path):
            first, last = [message.data for message in read_log(path, (RUN,))]
            return _record(path, began, first, last)
        return _unfinished(path, began, "running" if going else "ended early")
    except (BrokenLogError, ValueError, KeyError):  # also a log whose messages are not those of a run
        return RunRecord(_id(path), path, began, "damaged")


def _record(path: Path, began: float, first: dict[str, Any], last: dict[str, Any]) -> RunRecord:
    return RunRecord(_id(path), path, began, last["outcome"], first["target"], first["settings"], first["host"], first["jobs"],
                     last["counts"], last["seconds"], last["cpu_s"], last["own_cpu_s"], last["message"], tuple(last["table"]))


def _unfinished(path: Path, began: float, outcome: str) -> RunRecord:
    """Count what the log of a run without end holds so far."""
    counts: dict[str, dict[str, int]] = defaultdict(lambda: defaultdict(int))
    first: dict[str, Any] = {"target": "", "settings": {}, "host": "", "jobs": 0}
    cpu_s, seconds = 0.0, 0.0
    for topic, time_ns, data in read_log(path, (RUN, ENDS, HITS)):
        seconds = max(seconds, time_ns / 1e9 - began)
        if topic == RUN:
            first = data if data["event"] == "started" else first
        elif topic == HITS:
            counts["cached"][data["stage"]] += data["count"]
        else:
            counts[data["result"]][data["stage"]] += 1
            cpu_s += data["cpu_s"] if data["result"] == "ran" else 0.0
    plain = {result: dict(stages) for result, stages in counts.items()}
    return RunRecord(_id(path), path, began, outcome, first["target"], first["settings"], first["host"], first["jobs"], plain,
                     round(seconds, 3), round(cpu_s, 3))


def logged_tasks(path: Path) -> list[LoggedTask]:
    """Tasks of a run that ran, failed, or were running at its end, by start. BrokenLogError."""
    open_tasks: dict[tuple[str, str], LoggedMessage] = {}
    done, last = [], 0.0
    for message in read_log(path, (RUN, STARTS, ENDS)):
        data, last = message.data, max(last, message.time_ns / 1e9)
        if message.topic == STARTS:
            open_tasks[data["stage"], data["shard"]] = message
        elif message.topic == ENDS:
            open_tasks.pop((data["stage"], data["shard"]), None)
            done.append(LoggedTask(*(data[name] for name in LoggedTask._fields)))
    done += [LoggedTask(stage, shard, "running", message.time_ns / 1e9, last, 0.0, 0.0, message.data["reason"], "")
             for (stage, shard), message in open_tasks.items()]
    return sorted((task for task in done if task.result in ("ran", "failed", "running")), key=lambda task: task.start)


def expired(store: Path, keep: int = KEEP, days: float = DAYS) -> Iterator[Path]:
    """Yield the logs beyond the last `keep` runs or older than `days`, and the pieces of tables that no other log names.

    The last run is never among them. No run may be open.
    """
    paths, now = run_paths(store), time.time()
    old = [path for at, path in enumerate(paths) if at and (at >= keep or now - _began(path) > days * DAY_S)]
    yield from old
    used = {piece for path in paths if path not in set(old) for piece in read_run(path).table or ()}
    yield from _unused_pieces(store / "runs", used)


def _unused_pieces(runs: Path, used: Iterable[str]) -> Iterator[Path]:
    kept = {piece_path(runs, digest).name for digest in used}
    with suppress(FileNotFoundError):
        yield from (runs / "tables" / name for name in os.listdir(runs / "tables") if name not in kept)


def _id(path: Path) -> str:
    return _match(path)["id"]


def _began(path: Path) -> float:
    words, _, fraction = _match(path)["time"].partition(".")
    return calendar.timegm(time.strptime(words, "%Y%m%dT%H%M%S")) + int(fraction) / 1000


def _match(path: Path) -> re.Match[str]:
    found = NAME.fullmatch(path.name)
    if found is None:
        raise ValueError(f"{path} is not the log of a run")
    return found
