"""Record of a run: an MCAP log of its tasks, hits, failures and resources, written while it goes on.

    runs/<UTC time>-<host>-<id>.mcap            a run that has ended
    runs/.<UTC time>-<host>-<id>.mcap.part      a run that goes on, or was killed; its writer holds a kernel lock on it

Log time is the wall clock. Tasks that are cached are counted by stage; every other task has messages of its own. The complete table
stage -> shard -> key is stored apart (runner/run_table.py), and the log names its pieces. No credential is recorded
(runner/masking.py).
"""

from __future__ import annotations

import fcntl
import os
import time
import uuid
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Event, Lock, Thread
from types import TracebackType
from typing import Any, Self

from runner.files import host
from runner.lease import has_writer
from runner.log_file import LogWriter
from runner.masking import mask, mask_text
from runner.process_tree import tree_usage
from runner.report import Observer, Reason, Result, RunReport, SilentObserver
from runner.run_table import Keys, write_table
from runner.store import StoreError

FLUSH_S, SAMPLE_S = 1.0, 5.0
"""seconds between two flushes, and between two samples of the resources"""
PART = ".part"
MESSAGE = 2000
"""characters kept of an error message"""


def _schema(title: str, what: str, **fields: str) -> dict[str, Any]:
    """JSON schema of one topic; a field is 'type: description'."""
    parts = {name: text.partition(": ") for name, text in fields.items()}
    return {"title": title, "description": what, "type": "object",
            "properties": {name: {"type": kind, "description": meaning} for name, (kind, _, meaning) in parts.items()}}  # fmt: skip


RUN, STARTS, ENDS, HITS, FAILURES, RESOURCES = "/run", "/starts", "/ends", "/hits", "/failures", "/resources"
TASK = {"stage": "string: name of the stage", "shard": "string: shard, '' for a stage that runs once"}
TOPICS = {
    RUN: _schema("Run", "Start and end of the run", event="string: started or ended", id="string: id of the run",
                 target="string: target", settings="object: arguments as typed, without credentials", host="string: machine",
                 pid="integer: process", jobs="integer: worker processes", outcome="string: ok, failed, stopped or error",
                 message="string: error that ended the run", seconds="number: wall time", cpu_s="number: CPU seconds of tasks",
                 own_cpu_s="number: CPU seconds of this process", counts="object: result -> stage -> number of tasks",
                 table="array: digests of the pieces of the table stage -> shard -> key"),
    STARTS: _schema("Start", "A worker has started a task", **TASK, reason="string: reason of the run"),
    ENDS: _schema("End", "A task has run, or failed, or is blocked or deferred", **TASK, result="string: ran, failed, blocked or "
                  "deferred", start="number: start, seconds since 1970", end="number: end, seconds since 1970",
                  wall_s="number: wall seconds in the worker", cpu_s="number: CPU seconds", peak_mib="number: peak memory, MiB",
                  key="string: key, '' where it is not known", reason="string: reason of the run", message="string: cause"),
    HITS: _schema("Hits", "Tasks whose output was stored, since the last message", stage="string: name of the stage",
                  count="integer: number of tasks"),
    FAILURES: _schema("Failure", "A task has failed", **TASK, message="string: error"),
    RESOURCES: _schema("Resources", "Use by the scheduler and its workers", cpu_s="number: CPU seconds since the start",
                       rss_mib="number: resident memory, MiB", processes="integer: processes", running="integer: running tasks"),
}  # fmt: skip


class RunLog:
    """Observer that records a run, and passes each event on to `observer`.

    A context manager: the log begins and ends with the block. `ended` takes the report of the run; an error that leaves the block
    is recorded. `settings` are the arguments as typed by the user.

    StoreError when the log cannot be written.
    """

    def __init__(self, store: Path, target: str, settings: Mapping[str, Any] | None = None, observer: Observer | None = None,
                 jobs: int = 0) -> None:
        self.runs = store / "runs"
        self.name = run_name()
        self._observer = observer or SilentObserver()
        self._first = {"event": "started", "id": self.name[-8:], "target": target, "settings": mask(dict(settings or {})),
                       "host": host(), "pid": os.getpid(), "jobs": jobs}
        self._counts: dict[str, Counter[str]] = defaultdict(Counter)
        self._hits: Counter[str] = Counter()
        self._running: dict[tuple[str, str], tuple[float, str]] = {}
        self._report = RunReport(target)
        self._used: Keys = {}
        self._cpu_s, self._known, self._failed = 0.0, 0, False
        self._lock, self._over, self._beat = Lock(), Event(), Thread(target=self._flushing, daemon=True)
        self._error: OSError | None = None

    # -- begin and end ---------------------------------------------------------------------------------------------------

    def __enter__(self) -> Self:
        self._began = time.monotonic(), time.process_time()
        with _explained():
            self.runs.mkdir(parents=True, exist_ok=True)
            collect(self.runs)
            self._part = self.runs / f".{self.name}.mcap{PART}"
            self._file = os.open(self._part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
            fcntl.flock(self._file, fcntl.LOCK_EX)
            self._log = LogWriter(self._file, TOPICS)
            self._log.write(RUN, time.time_ns(), self._first)
            self._log.flush()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._over.set()
        if self._beat.ident is not None:
            self._beat.join()
        try:
            with _explained():
                self._finish(error)
        finally:
            os.close(self._file)

    def ended(self, report: RunReport) -> None:
        """Take the report at the end of a run; of several runs in one block, the tables are joined."""
        for stage, shards in report.used.items():
            self._used.setdefault(stage, {}).update(shards)
        self._failed = self._failed or not report.ok

    def _finish(self, error: BaseException | None) -> None:
        if error is not None and not self._known:  # refused before anything was planned, like an unknown shard
            self._part.unlink(missing_ok=True)
            return
        self._count_hits()
        last = {"event": "ended", "id": self.name[-8:], "outcome": self._outcome(error), "message": _short(error) if error else "",
                "seconds": round(time.monotonic() - self._began[0], 3), "cpu_s": round(self._cpu_s, 3),
                "own_cpu_s": round(time.process_time() - self._began[1], 3),
                "counts": {result: dict(stages) for result, stages in self._counts.items()},
                "table": write_table(self.runs, self._used)}
        self._log.write(RUN, time.time_ns(), last)
        self._log.finish()
        _publish(self._part)

    def _outcome(self, error: BaseException | None) -> str:
        if error is None:
            return "failed" if self._failed or self._counts.get("failed") else "ok"
        return "error" if isinstance(error, Exception) else "stopped"

    # -- events of the run -----------------------------------------------------------------------------------------------

    def begun(self, report: RunReport) -> None:
        """Follow the report, from which keys and memory of tasks are read."""
        self._report = report
        self._observer.begun(report)

    def planned(self, stage: str, shard: str) -> None:
        """Pass on; a run without any task leaves no log if it is refused."""
        self._known += 1
        self._observer.planned(stage, shard)

    def started(self, stage: str, shard: str, reason: Reason) -> None:
        """Record the start of a task."""
        now = time.time()
        self._running[stage, shard] = now, str(reason)
        self._write(STARTS, now, {"stage": stage, "shard": shard, "reason": str(reason)})
        self._observer.started(stage, shard, reason)

    def progress(self, stage: str, shard: str, done: int, total: int) -> None:
        """Pass on."""
        self._observer.progress(stage, shard, done, total)

    def cached(self, stage: str, count: int) -> None:
        """Count tasks whose output was stored."""
        self._known += count
        self._hits[stage] += count
        self._counts["cached"][stage] += count
        self._observer.cached(stage, count)

    def finished(self, stage: str, shard: str, result: Result, wall_s: float, cpu_s: float, message: str) -> None:
        """Record the end of a task."""
        now = time.time()
        began, reason = self._running.pop((stage, shard), (now - wall_s, ""))
        self._counts[result][stage] += 1
        self._cpu_s += cpu_s if result == "ran" else 0.0
        short = mask_text(message[:MESSAGE]) if message else ""
        self._write(ENDS, now, {
            "stage": stage, "shard": shard, "result": result, "start": round(began, 4), "end": round(now, 4),
            "wall_s": round(wall_s, 4), "cpu_s": round(cpu_s, 4), "key": self._key(stage, shard, result), "reason": reason,
            "peak_mib": round(self._report.peak_mib.get((stage, shard), 0.0), 1), "message": short})
        if result == "failed":
            self._write(FAILURES, now, {"stage": stage, "shard": shard, "message": short})
        self._observer.finished(stage, shard, result, wall_s, cpu_s, message)

    def _key(self, stage: str, shard: str, result: Result) -> str:
        """Key of the task, as far as the report has it at this moment."""
        last = self._report.failures[-1] if result == "failed" and self._report.failures else None
        if last is not None and (last.stage, last.shard) == (stage, shard):
            return last.key
        return self._report.used.get(stage, {}).get(shard, "")

    # -- the file --------------------------------------------------------------------------------------------------------

    def _write(self, topic: str, when: float, data: Mapping[str, Any]) -> None:
        if self._error is not None:
            with _explained():
                raise self._error
        if self._beat.ident is None:  # a run with nothing to do needs no thread and no compression
            self._log.compress = True
            self._beat.start()
        with self._lock, _explained():
            self._log.write(topic, int(when * 1e9), data)

    def _flushing(self) -> None:
        """Flush every second, and sample the resources now and then; an error ends the run at its next event."""
        sampled = 0.0
        try:
            while not self._over.wait(FLUSH_S):
                sample = tree_usage() if time.monotonic() - sampled >= SAMPLE_S else None
                sampled = time.monotonic() if sample else sampled
                with self._lock:
                    if sample:
                        self._log.write(RESOURCES, time.time_ns(), {**sample._asdict(), "running": len(self._running)})
                    self._count_hits()
                    self._log.flush()
        except OSError as error:
            self._error = error

    def _count_hits(self) -> None:
        hits, self._hits = self._hits, Counter()
        for stage, count in hits.items():
            self._log.write(HITS, time.time_ns(), {"stage": stage, "count": count})


def run_name() -> str:
    """UTC time in milliseconds, host and a random id, which the names of runs sort by."""
    now = time.time()
    return f"{time.strftime('%Y%m%dT%H%M%S', time.gmtime(now))}.{int(now * 1000) % 1000:03}Z-{host()}-{uuid.uuid4().hex[:8]}"


def collect(runs: Path) -> list[Path]:
    """Give the logs of killed runs their final names, and return them; those whose writer lives are locked, and stay."""
    found = []
    for name in os.listdir(runs):
        if name.startswith(".") and name.endswith(PART) and not has_writer(runs / name):
            with suppress(FileNotFoundError):  # another run has done it
                found.append(_publish(runs / name))
    return found


def final_path(part: Path) -> Path:
    """Final place of a log that is written under a hidden name."""
    return part.with_name(part.name[1:].removesuffix(PART))


def _publish(part: Path) -> Path:
    try:
        os.rename(part, final_path(part))
    except FileNotFoundError:
        if not final_path(part).exists():  # a run on a host that sees no locks of ours may have renamed it
            raise
    return final_path(part)


@contextmanager
def _explained() -> Iterator[None]:
    """Turn an OSError into a StoreError with one clear sentence."""
    try:
        yield
    except StoreError:
        raise
    except OSError as error:
        raise StoreError(error.errno, f"the history in runs/ could not be written ({error.strerror or error}); finished tasks are "
                                      "kept, free some space and run again") from error


def _short(error: BaseException) -> str:
    return mask_text(str(error)[:MESSAGE])
