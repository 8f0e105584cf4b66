"""Kills at any moment, concurrent runs, and damaged or missing files."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import pytest
from toy import shout
from toy_project import HERE, Project, graph, text, wait_until

from runner.files import unique, write_atomic
from runner.lease import Lease, has_writer

WORDS = ("ab", "cd", "ef")
TASKS = 3 + 6 + 6 + 1


@pytest.fixture
def project(tmp_path: Path) -> Project:
    return Project.make(tmp_path)


def start(project: Project, sleep_s: float = 0.0, words: tuple[str, ...] = WORDS) -> subprocess.Popen[str]:
    command = [sys.executable, str(HERE / "toy_main.py"), str(project.store), str(project.root), "2", str(sleep_s), *words]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, start_new_session=True)


def finished(project: Project) -> set[str]:
    """Keys with a trace."""
    return set(project.runner().index.keys())


def blobs(project: Project) -> list[Path]:
    return sorted((project.store / "blobs").glob("??/*"))


def flip(path: Path) -> None:
    """Flip one bit, and keep the modification time."""
    before = path.stat()
    path.chmod(0o644)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))


@pytest.mark.slow
def test_kills_at_random_moments_lose_nothing_finished(project: Project) -> None:
    """kill -9 of the scheduler at 20 random moments: finished tasks never run again, and the outputs are right."""
    chance = random.Random(7)
    for i in range(20):
        run = start(project, 0.02, (*WORDS, f"x{i}"))
        time.sleep(chance.uniform(0.15, 0.6))
        os.killpg(run.pid, signal.SIGKILL)
        run.wait()
        if i % 5 == 4:
            wait_until(lambda: not alive(project))
            before, _ = finished(project), project.executed()
            run = start(project, 0.02, (*WORDS, f"x{i}"))
            assert run.communicate()[0] and run.returncode == 0
            assert before <= finished(project)
            assert sum(project.executed().values()) == len(finished(project)) - len(before)
    assert project.runner().verify().ok
    assert text(project, project.run(*WORDS, params=shout.Params(sleep_s=0.02))) == "A A C C E E"


def alive(project: Project) -> bool:
    """Return True while a process writes to the store."""
    return any(has_writer(path) for path in (project.store / "traces").glob("[!.]*"))


def test_workers_end_with_their_scheduler(project: Project) -> None:
    """kill -9 of the scheduler alone leaves no working process."""
    run = start(project, 30.0)
    wait_until(lambda: project.log.exists() and "shout" in project.log.read_text())
    run.kill()
    run.wait()
    wait_until(lambda: not alive(project), 5.0)


def test_an_interrupted_run_ends_cleanly(project: Project) -> None:
    """Ctrl-C: no worker and no lease remain, and finished results stay."""
    run = start(project, 30.0)
    wait_until(lambda: project.log.exists() and "shout" in project.log.read_text())
    os.kill(run.pid, signal.SIGINT)
    run.communicate()
    assert run.returncode != 0 and not alive(project)
    assert len(finished(project)) >= 1


def test_sigterm_ends_a_run_as_an_interrupt_does(project: Project) -> None:
    """No worker and no lease remain, caches are written, finished results stay; the status is that of the signal."""
    run = start(project, 30.0)
    wait_until(lambda: project.log.exists() and "shout" in project.log.read_text())
    run.terminate()
    run.communicate()
    assert run.returncode == 143 and not alive(project)
    assert len(finished(project)) >= 1 and (project.store / ".cache" / "modules.json").exists()


def test_leftovers_of_a_killed_run_go_with_the_next_run(project: Project) -> None:
    """Save folders are removed, except those of a living process."""
    run = start(project, 30.0)
    wait_until(lambda: project.log.exists() and "shout" in project.log.read_text())
    os.killpg(run.pid, signal.SIGKILL)
    run.wait()
    wait_until(lambda: not alive(project))
    mine = project.store / "scratch" / unique("save")[1:]
    mine.mkdir()
    wait_until(lambda: project.run("ab").ok and list((project.store / "scratch").glob("save*")) == [mine])


def test_two_runs_at_once_do_every_task_once(project: Project) -> None:
    """Both succeed, and the log of executions has every task once."""
    runs = [start(project, 0.05) for _ in range(2)]
    result = [run.communicate()[0].split() for run in runs]
    assert [run.returncode for run in runs] == [0, 0]
    assert project.executed() == {"split": 3, "shout": 6, "pair": 6, "join": 1}
    assert sum(int(ran) for ran, _ in result) == TASKS


def test_a_worker_that_is_killed_fails_its_shard_alone(project: Project) -> None:
    """One clear sentence; the pool continues."""
    report = project.run("ab", "kill", jobs=2)
    assert {failure.shard for failure in report.failures} == {"w1/w1.0", "w1/w1.1"}
    assert "ended with signal SIGKILL" in report.failures[0].message and "memory" in report.failures[0].message
    assert text(project, report) == "A A"


@pytest.mark.parametrize("damage", ["flip", "cut", "remove"])
def test_a_damaged_blob_is_found_and_made_again(damage: str, project: Project) -> None:
    """A blob that was flipped, cut or deleted exists again after the next run, whose outputs are right."""
    report = project.run("ab")
    for path in blobs(project):
        before = path.read_bytes()
        if damage == "flip":
            flip(path)
        else:
            path.unlink()
            if damage == "cut":
                path.write_bytes(before[:3])
        again = project.run("ab")
        assert again.ok and again.outputs == report.outputs
        leaf = not any(again.ran.values())
        assert leaf or path.read_bytes() == before
        if leaf:
            path.unlink(missing_ok=True)
            path.write_bytes(before)
    assert text(project, report) == "A A"


def test_a_blob_damaged_behind_the_back_of_a_run_is_healed_when_it_is_read(project: Project) -> None:
    """The planner misses the damage. The reading worker finds it, the producer runs again, and the reader gets valid bytes."""
    first = project.run("ab", jobs=1)
    project.executed()
    runner = project.runner(1)
    runner.store._verified_blobs.same = lambda blob, found: found.st_size > 0  # type: ignore[method-assign]
    joined = runner.store.manifest(first.outputs["join"][0][1]).files[0].blob
    for path in blobs(project):
        if path != runner.store.path("blobs", joined):
            flip(path)
    report = runner.run(graph("ab", params=shout.Params(backend="other")), "all")
    assert report.ok and text(project, report) == "A A"
    assert project.executed()["split"] >= 1


def test_verify_sets_damage_aside_and_the_next_run_heals(project: Project) -> None:
    """verify names the blob and moves it to damaged/; the reason of the next run is 'output damaged'."""
    report = project.run("ab", jobs=1)
    joined = project.runner().store.manifest(report.outputs["join"][0][1]).files[0].blob
    flip(project.runner().store.path("blobs", joined))
    verdict = project.runner().verify()
    assert verdict.damaged == [joined] and (project.store / "damaged" / joined).exists() and not verdict.ok
    plan = {p.stage: str(p.reason) for p in project.runner().plan(graph("ab"), "all") if p.status == "run"}
    assert plan == {"join": "output damaged"}
    assert project.run("ab", jobs=1).ran == {"join": 1}
    assert project.runner().verify().ok


def test_a_lost_index_is_made_again(project: Project) -> None:
    """Losing or damaging files in .cache runs no task again."""
    project.run("ab")
    project.executed()
    for path in (project.store / ".cache").iterdir():
        path.write_text("{torn")
    assert project.run("ab").ran == {}
    assert project.executed() == Counter()


def test_a_torn_segment_counts_as_lost(project: Project) -> None:
    """Its tasks run again."""
    project.run("ab")
    for path in (project.store / "traces").iterdir():
        path.write_text("{")
    report = project.run("ab")
    assert report.ok and text(project, report) == "A A"


def test_a_lease_is_exclusive_and_ends_with_its_owner(tmp_path: Path) -> None:
    """A second owner is refused, kill -9 frees the lease, and removing the file while waiting gives no two owners."""
    path = tmp_path / "key.lock"
    code = f"import sys, time; sys.path.insert(0, {str(HERE.parents[1])!r}); from pathlib import Path\n"
    code += "from runner.lease import Lease\n"
    code += f"lease = Lease(Path({str(path)!r})); print(lease.held, flush=True); time.sleep(60)"
    owner = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert owner.stdout is not None and owner.stdout.readline() == "True\n"
    assert not Lease(path).held
    owner.kill()
    owner.wait()
    mine = Lease(path)
    assert mine.held and not Lease(path).held
    mine.release()
    assert not path.exists() and Lease(path).held


def test_a_file_is_replaced_whole(tmp_path: Path) -> None:
    """Parent folders are created, and no temporary file remains."""
    write_atomic(tmp_path / "a" / "b", b"1")
    write_atomic(tmp_path / "a" / "b", b"2")
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["b"] and (tmp_path / "a" / "b").read_bytes() == b"2"
