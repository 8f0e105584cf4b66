"""Engines: order of messages, deaths, time-outs, replaced workers, GPUs of workers."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from runner.channel import Channel
from runner.engines import Engine, Inline, Message, Pool
from runner.execute import Job, JobResult, JobSpec, WorkerSpec
from runner.resources import Resources
from runner.store import prepare_store

STAGE = '''
import os, signal, subprocess, sys, time
from toy.values import Word

kept = []

def run(params, ctx):
    what, _, more = params.partition(" ")
    if what == "die":
        os.kill(os.getpid(), int(more))
    elif what == "exit":
        os._exit(int(more))
    elif what == "sleep":
        time.sleep(float(more))
    elif what == "stop":
        os.kill(os.getpid(), signal.SIGSTOP)
    elif what == "progress":
        for n in range(int(more)):
            time.sleep(0.1)
            ctx.progress(n, int(more))
    elif what == "child":  # holds everything that it can inherit
        child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"], close_fds=False)
        open(more, "w").write(str(child.pid))
        os.kill(os.getpid(), signal.SIGKILL)
    elif what == "grow":
        kept.append(bytearray(os.urandom(1) * (int(more) << 20)))
    elif what == "pid":
        return Word(str(os.getpid()), os.environ.get("CUDA_VISIBLE_DEVICES", "all"))
    return Word(what, more)
'''


class Work:
    """A store, and jobs whose parameter says what they do."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.number = folder, 0
        (folder / "code").mkdir()
        (folder / "code" / "work.py").write_text(STAGE)
        self.spec = WorkerSpec(folder / "store", "toy.values:CODEC", None, folder / "code", (), session="test")
        prepare_store(self.spec.store)

    def job(self, what: str, timeout_s: float = 60.0) -> Job:
        self.number += 1
        spec = JobSpec(stage="work", function="work:run", params=what, params_tree=None, wants_ctx=True, code="0", libraries={},
                       threads=1, machine="", resources=Resources(), timeout_s=timeout_s, sources=())
        key = f"{self.number:015x}".ljust(64, "0")
        return Job(spec=spec, key=key, shard="", inputs={}, schemas={}, manifests={}, reason="", force=False)

    def jobs(self, *what: str, timeout_s: float = 60.0) -> list[Job]:
        return [self.job(one, timeout_s) for one in what]


@pytest.fixture
def work(tmp_path: Path) -> Work:
    return Work(tmp_path)


@pytest.fixture
def pool(work: Work, monkeypatch: pytest.MonkeyPatch) -> Iterator[Pool]:
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).resolve().parents[1] / "toy_domain"))
    made = Pool(work.spec)
    yield made
    made.close()


def finish(engine: Engine, jobs: list[Job]) -> tuple[dict[str, JobResult], list[Message]]:
    """Results by key, and all messages, once every job has a result."""
    results, seen = dict[str, JobResult](), list[Message]()
    while len(results) < len(jobs):
        seen += (messages := engine.wait(60.0))
        assert messages, "no message in a minute"
        results |= {key: payload for what, key, payload in messages if what == "done"}
    return results, seen


def statuses(engine: Engine, jobs: list[Job]) -> list[str]:
    results, _ = finish(engine, jobs)
    return [results[job.key].status for job in jobs]


def started(engine: Engine, job: Job) -> None:
    """Wait for the start of a job."""
    while ("started", job.key, None) not in engine.wait(60.0):
        pass


@pytest.mark.parametrize("kind", [Inline, Pool])
def test_a_job_is_started_then_done_and_jobs_of_a_batch_run_in_order(kind: Any, work: Work,
                                                                     monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is in flight after the last message, and waiting then takes no time."""
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).resolve().parents[1] / "toy_domain"))
    monkeypatch.syspath_prepend(str(work.spec.root))
    engine = kind(work.spec)
    jobs = work.jobs(*"abcd", "progress 3")
    engine.submit(jobs)
    results, seen = finish(engine, jobs)
    assert {result.status for result in results.values()} == {"ran"}
    told = [(what, key) for what, key, _ in seen if what != "progress"]
    assert told == [(what, job.key) for job in jobs for what in ("started", "done")]
    reports = [payload for what, _, payload in seen if what == "progress"]
    assert reports and reports == sorted(reports) and seen[-1][0] == "done"
    assert engine.wait(None) == []
    engine.close()


@pytest.mark.parametrize(("what", "how", "hint"), [("die 9", "signal SIGKILL", True), ("die 11", "signal SIGSEGV", False),
                                                   ("exit 3", "exit status 3", False), ("exit 0", "exit status 0", False)])
def test_a_worker_that_dies_fails_the_job_that_ran(what: str, how: str, hint: bool, work: Work, pool: Pool) -> None:
    """Jobs before it are done, those after it are returned, also when all of them take no time; the pool goes on."""
    jobs = work.jobs("a", "b", what, "c", "d")
    pool.submit(jobs)
    results, _ = finish(pool, jobs)
    died = results[jobs[2].key]
    assert died.status == "died" and how in died.message and ("MEMORY_GIB" in died.message) == hint
    assert [results[job.key].status for job in jobs[3:]] == ["returned"] * 2
    assert all(results[job.key].status in ("ran", "returned") for job in jobs[:2])
    pool.submit(jobs[:2] + jobs[3:])
    assert all(status in ("ran", "cached") for status in statuses(pool, jobs[:2] + jobs[3:])), "a finished job is not lost"


def test_a_worker_that_died_while_idle_costs_no_job(work: Work, pool: Pool) -> None:
    """Its jobs are returned without blame."""
    first = work.jobs("pid")
    pool.submit(first)
    finish(pool, first)
    os.kill(pool._workers[0]._process.pid, signal.SIGKILL)
    jobs = work.jobs("a", "b")
    pool.submit(jobs)
    assert statuses(pool, jobs) == ["returned", "returned"]
    pool.submit(jobs)
    assert statuses(pool, jobs) == ["ran", "ran"]


def test_workers_that_cannot_start_blame_every_job(work: Work, pool: Pool) -> None:
    """Otherwise the jobs would be returned for ever."""
    pool._spec = WorkerSpec(work.spec.store, "no_module:CODEC", None, work.spec.root, (), session="test")
    jobs = work.jobs("a", "b")
    pool.submit(jobs)
    assert statuses(pool, jobs) == ["died", "died"]


def test_processes_that_outlive_a_worker_do_not_hide_its_death(work: Work, pool: Pool, tmp_path: Path) -> None:
    """They hold its connection; they are killed with it."""
    jobs = work.jobs(f"child {tmp_path / 'pid'}")
    pool.submit(jobs)
    assert statuses(pool, jobs) == ["died"]
    assert wait_until(lambda: not is_alive(int((tmp_path / "pid").read_text())))


def is_alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"


def wait_until(condition: Callable[[], bool]) -> bool:
    end = time.monotonic() + 30
    while not condition() and time.monotonic() < end:
        time.sleep(0.01)
    return condition()


def warm(work: Work, pool: Pool, count: int) -> None:
    """Start workers, so that the time of a start does not count in the time-out of a job."""
    jobs = work.jobs(*["sleep 0.1"] * count)
    for job in jobs:
        pool.submit([job])
    finish(pool, jobs)


@pytest.mark.parametrize("what", ["sleep 600", "stop"])
def test_a_job_without_progress_is_stopped(what: str, work: Work, pool: Pool) -> None:
    """The message names TIMEOUT_S; the rest of the batch is returned, and other workers go on."""
    warm(work, pool, 2)
    other, jobs = work.jobs("sleep 3"), work.jobs("a", what, "b", timeout_s=2.0)
    pool.submit(other)
    pool.submit(jobs)
    results, _ = finish(pool, [*jobs, *other])
    assert [results[job.key].status for job in (*jobs[1:], *other)] == ["failed", "returned", "ran"]
    assert results[jobs[0].key].status in ("ran", "returned"), "its result may be under way"
    message = "the task made no progress for 2 s and was stopped; raise TIMEOUT_S of the stage, or report progress through ctx"
    assert results[jobs[1].key].message == message


def test_reports_of_progress_restart_the_clock(work: Work, pool: Pool) -> None:
    """The job takes longer than its time-out."""
    warm(work, pool, 1)
    jobs = work.jobs("progress 25", timeout_s=2.0)
    pool.submit(jobs)
    assert statuses(pool, jobs) == ["ran"]


def test_a_start_is_reported_while_the_job_runs(work: Work, pool: Pool) -> None:
    """Also for a slow job after quick ones, whose results are reported then."""
    jobs = work.jobs("a", "b", "sleep 600")
    pool.submit(jobs)
    seen: list[Message] = []
    while ("started", jobs[2].key, None) not in seen:
        seen += pool.wait(60.0)
    assert [message[0] for message in seen] == ["started", "done", "started", "done", "started"]


def test_an_ended_job_is_not_reported_and_the_others_are_returned(work: Work, pool: Pool) -> None:
    """Also when the end comes again, or for a job that is not there."""
    jobs = work.jobs("a", "sleep 600", "b", "c")
    pool.submit(jobs)
    started(pool, jobs[1])
    for job in (jobs[1], jobs[2], work.job("x")):
        pool.end(job.key)
    assert pool.wait(0) == [("done", jobs[3].key, JobResult(jobs[3].key, "returned"))]
    pool.submit(jobs[2:])
    assert statuses(pool, jobs[2:]) == ["ran", "ran"]


def test_waiting_ends_with_its_time(work: Work, pool: Pool) -> None:
    """No message is there, and the job goes on."""
    jobs = work.jobs("sleep 600")
    pool.submit(jobs)
    started(pool, jobs[0])
    assert pool.wait(0.01) == [] and pool.wait(0) == []


def pids(work: Work, pool: Pool, rounds: int, what: str = "pid", gpus: tuple[str, ...] = ()) -> list[int]:
    """Process of the worker in each of several batches of one job."""
    found = []
    for _ in range(rounds):
        jobs = work.jobs(what)
        pool.submit(jobs, gpus)
        finish(pool, jobs)
        found.append(pool._workers[-1]._process.pid)
    return found


def test_workers_are_replaced_after_many_jobs_or_when_they_have_grown(work: Work, pool: Pool) -> None:
    """Between two batches; the old process ends by itself."""
    pool._max_jobs, pool._max_growth_mib = 3, 1000.0
    first = pids(work, pool, 7)
    assert first[0] == first[2] != first[3] == first[5] != first[6]
    pool._max_jobs, pool._max_growth_mib = 1000, 50.0
    assert len(set(pids(work, pool, 4, "grow 1"))) == 1
    second = pids(work, pool, 3, "grow 40")
    assert second[0] == second[1] != second[2]
    assert wait_until(lambda: not any(map(is_alive, {*first, *second} - {second[2]})))


def test_a_worker_sees_the_gpus_of_its_grant(work: Work, pool: Pool, monkeypatch: pytest.MonkeyPatch) -> None:
    """It keeps them for life; another combination replaces it, and tasks without GPU keep their own worker."""
    monkeypatch.delenv("CUDA_VISIBLE_DEVICES", raising=False)
    (plain,) = pids(work, pool, 1)
    first = pids(work, pool, 2, "pid", ("1",))
    other = pids(work, pool, 1, "pid", ("0",))
    both = pids(work, pool, 1, "pid", ("0", "1"))
    assert first[0] == first[1] and len({plain, first[0], *other, *both}) == 4
    environment = Path(f"/proc/{both[0]}/environ").read_bytes().split(b"\0")
    assert b"CUDA_VISIBLE_DEVICES=0,1" in environment and is_alive(plain)
    assert wait_until(lambda: not is_alive(first[0]) and not is_alive(other[0]))
    assert [worker._process.pid for worker in pool._workers] == [plain, *both]


def test_close_ends_idle_and_busy_workers(work: Work, pool: Pool) -> None:
    """No process remains."""
    busy, idle = work.jobs("sleep 600"), work.jobs("a")
    pool.submit(busy)
    pool.submit(idle)
    while not any(what == "done" for what, _, _ in pool.wait(60.0)):
        pass
    found = [worker._process.pid for worker in pool._workers]
    pool.close()
    assert len(found) == 2 and not any(map(is_alive, found))


def test_a_large_batch_does_not_stop_the_scheduler() -> None:
    """What the socket does not take is sent later, in order; a reader sees whole messages only."""
    import socket

    ours, theirs = socket.socketpair()
    scheduler, worker = Channel(ours.detach(), blocking=False), Channel(theirs.detach())
    big = os.urandom(3 << 20)
    for message in ("first", big, "last"):
        scheduler.post(message)
    assert scheduler.pending and worker.receive() == "first"
    while scheduler.pending:
        scheduler.push()
        worker._incoming += os.read(worker.fileno(), 1 << 16)
    assert worker.receive() == big and worker.receive() == "last"
    os.write(worker.fileno(), (20).to_bytes(8, "little") + b"half")
    assert scheduler.arrived() == [] and not scheduler.ended
    worker.close()
    assert scheduler.arrived() == [] and scheduler.ended
    scheduler.post("to nobody")
    scheduler.push()
    assert not scheduler.pending
    scheduler.close()
