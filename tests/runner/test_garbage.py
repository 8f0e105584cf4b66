"""Garbage collection and disk usage: what is kept, what is dropped, and who waits for whom."""

from __future__ import annotations

import os
import threading
import time
from pathlib import Path

import pytest
from toy import shout
from toy.values import Word
from toy_project import Project, graph, wait_until

from runner import LostError, Runner, RunReport, StoreError
from runner.garbage import ELSEWHERE, HISTORY, GcResult, Rules, UnknownStageError
from runner.history import RunLog
from runner.lease import Lease
from runner.past_runs import run_paths

STAGES = ("split", "shout", "pair", "join")


@pytest.fixture
def project(tmp_path: Path) -> Project:
    return Project.make(tmp_path)


def blobs(project: Project) -> set[Path]:
    return {path for path in (project.store / "blobs").glob("??/*") if not path.name.startswith(".")}


def tree(project: Project) -> dict[Path, tuple[int, int]]:
    """Size and time of change of every file of the store, without locks and caches."""
    files = (path for path in project.store.rglob("*") if path.is_file() and path.parent.name not in ("leases", ".cache"))
    return {path: (path.stat().st_size, path.stat().st_mtime_ns) for path in files}


def outputs(project: Project, runner: Runner, report: RunReport) -> dict[str, list[object]]:
    return {name: [runner.load(digest) for _, digest in made] for name, made in report.outputs.items()}


# -- keep ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rules", [Rules(), Rules(keep_last=2), Rules(drop=("split",)), Rules(keep_last=2, older_than_days=1.0)])
def test_a_dry_run_deletes_nothing(project: Project, rules: Rules) -> None:
    """The result counts, by stage, what the same call deletes afterwards."""
    for backend in ("a", "b", "c"):
        project.run("ab", "cd", params=shout.Params(backend=backend))
    before = tree(project)
    counted = project.runner().gc(dry_run=True, rules=rules)
    assert tree(project) == before
    swept = project.runner().gc(rules=rules)
    assert swept == GcResult(**{**vars(counted), "dry_run": False})
    assert swept.bytes == sum(row["bytes"] for row in swept.stages.values())


def test_kept_outputs_can_be_loaded(project: Project) -> None:
    """Their tasks do not run again."""
    report = project.run("ab", "cd")
    project.run("ab", "cd", params=shout.Params(backend="other"))
    report = project.run("ab", "cd")
    expected = outputs(project, project.runner(), report)
    swept = project.runner().gc()
    assert swept.traces > 0
    assert outputs(project, project.runner(), report) == expected
    project.executed()
    assert project.run("ab", "cd").cached and project.executed() == {} and project.runner().verify().ok


def test_the_last_keys_of_every_shard_are_kept(project: Project) -> None:
    """Last uses count: with two kept, an undo is free; the third one back runs again."""
    for text in ('"!"', '"?"', '"."', '"!"'):
        project.edit("toy/helper.py", project_mark(project), text)
        project.run("ab")
    project.runner().gc(rules=Rules(keep_last=2))
    project.executed()
    project.edit("toy/helper.py", '"!"', '"."')
    project.run("ab")
    assert project.executed() == {}
    project.edit("toy/helper.py", '"."', '"?"')
    project.run("ab")
    assert project.executed().keys() >= {"shout"}


def project_mark(project: Project) -> str:
    """Mark in the helper's code, with its quotes."""
    line = next(line for line in (project.root / "toy/helper.py").read_text().splitlines() if line.startswith("MARK"))
    return line.partition(" = ")[2]


def test_lately_used_results_are_kept(project: Project) -> None:
    """A result counts as used until its successor was; afterwards its age decides."""
    project.run("ab")
    project.run("ab", params=shout.Params(backend="other"))
    assert project.runner().gc(dry_run=True).traces > 0
    assert project.runner().gc(rules=Rules(older_than_days=1.0)).traces == 0
    time.sleep(0.05)
    assert project.runner().gc(rules=Rules(older_than_days=0.01 / 86400)).traces > 0


def test_leftovers_and_old_runs_are_deleted(project: Project, monkeypatch: pytest.MonkeyPatch) -> None:
    """A blob without row, as a kill leaves it, a damaged blob, and logs beyond the limit."""
    for _ in range(2):
        with RunLog(project.store, "all") as log:
            log.ended(project.run("ab", observer=log))
    stray, damaged = project.store / "blobs" / "ab" / ("c" * 62), project.store / "damaged" / ("d" * 64)
    stray.parent.mkdir(exist_ok=True)
    stray.write_text("x")
    damaged.write_text("yy")
    monkeypatch.setattr("runner.past_runs.expired.__defaults__", (1, 90.0))
    swept = project.runner().gc()
    assert swept.stages[ELSEWHERE] == {"files": 1, "bytes": 1} and not stray.exists() and not damaged.exists()
    assert swept.stages[HISTORY]["files"] == 1 and len(run_paths(project.store)) == 1


# -- drop ----------------------------------------------------------------------------------------------------------------


def test_a_store_without_dropped_bytes_has_nothing_to_do(project: Project) -> None:
    """The tasks of the stage count as cached, in a plan and in a run; `verify` finds no fault."""
    first = project.run("ab", "cd")
    project.executed()
    swept = project.runner().gc(rules=Rules(drop=("split",)))
    assert swept.dropped > 0 and swept.stages["split"]["bytes"] > 0
    report = project.run("ab", "cd")
    assert (report.ran, project.executed()) == ({}, {}) and report.cached == first.ran and report.outputs == first.outputs
    assert {plan.status for plan in project.runner().plan(graph("ab", "cd"), "all")} == {"cached"}
    assert project.runner().verify().ok


def test_dropped_bytes_are_made_again_for_the_task_that_needs_them(project: Project) -> None:
    """One clip's, when what reads them must run for that clip; the others stay away."""
    project.run("ab", "cd")
    project.executed()
    project.runner().gc(rules=Rules(drop=("split",)))
    report = project.runner().run(graph("ab", "cd", params=shout.Params(backend="other")), "all", shards=["w0"])
    assert report.ok and project.executed()["split"] == 1
    assert project.runner().disk_usage().stages["split"].dropped > 0


def test_bytes_that_others_have_as_well_are_kept(project: Project) -> None:
    """Outputs of a stage that is not dropped stay readable, whatever they share with a dropped one."""
    report = project.run("ab", "cd")
    everything = {stage: [digest for _, digest in report.outputs.get(stage, [])] for stage in ("shout", "join")}
    project.runner().gc(rules=Rules(drop=("split", "pair")))
    runner = project.runner()
    assert all(isinstance(runner.load(digest), Word) for digests in everything.values() for digest in digests)


def test_published_files_keep_their_bytes(project: Project, tmp_path: Path) -> None:
    """A blob with a link outside is not deleted, since this frees nothing, and the artifact stays readable."""
    report = project.run("ab")
    runner = project.runner()
    key = report.used["split"]["w0"]
    made = runner.traces.output(key)
    assert made is not None
    part = next(digest for digest, found in runner.store.closure(made) if found and found.files)
    path = next(iter(runner.files(part).values()))
    os.link(path, tmp_path / "published")
    runner.gc(rules=Rules(drop=("split",)))
    assert path.exists() and runner.load(part)


def test_an_unknown_stage_is_refused(project: Project) -> None:
    """The error lists the stages that the store has, and comes before anything is deleted."""
    project.run("ab")
    before = blobs(project)
    with pytest.raises(UnknownStageError, match=r"--drop spilt: no task of this stage .*: join, pair, shout, split"):
        project.runner().gc(rules=Rules(drop=("spilt",)))
    assert blobs(project) == before


# -- leases --------------------------------------------------------------------------------------------------------------


def test_gc_is_refused_during_a_run_and_while_something_is_read(project: Project) -> None:
    """One sentence; afterwards it works."""
    project.run("ab")
    runner = project.runner()
    for block in (lambda: runner.reading(), lambda: runner._session()):
        with block(), pytest.raises(StoreError, match="run gc when it has ended"):
            project.runner().gc()
    assert project.runner().gc(dry_run=True).dry_run


def test_readers_wait_for_gc_and_see_its_result(project: Project) -> None:
    """A runner that was opened before finds the rows that gc has rewritten."""
    report = project.run("ab")
    project.run("ab", params=shout.Params(backend="other"))
    report = project.run("ab")
    runner, done = project.runner(), threading.Event()
    lease = Lease(project.store / "leases" / "store.lock")
    assert lease.held

    def read() -> None:
        with runner.reading():
            runner.load(report.outputs["join"][0][1])
        done.set()

    reader = threading.Thread(target=read)
    reader.start()
    assert not done.wait(0.2)
    lease.release(remove=False)
    wait_until(done.is_set)
    reader.join()
    old = project.runner()
    assert project.runner().gc().traces > 0
    with old.reading():
        assert len(old.traces) == len(project.runner().traces) and old.load(report.outputs["join"][0][1])


def test_a_run_after_gc_knows_what_was_deleted(project: Project) -> None:
    """A runner that was opened before gc does not take deleted results for cached ones."""
    other = shout.Params(backend="other")
    project.run("ab", params=other)
    project.run("ab")
    old = project.runner()
    assert project.runner().gc().traces > 0
    project.executed()
    report = old.run(graph("ab", params=other), "all")
    assert report.ok and project.executed()["shout"] == 2


def test_a_result_that_ends_before_gc_is_kept(project: Project) -> None:
    """The index is read again under the lease: a runner that was opened before a run knows its results."""
    old = project.runner()
    report = project.run("ab")
    old.gc()
    assert project.runner().load(report.outputs["join"][0][1])


# -- disk usage ----------------------------------------------------------------------------------------------------------


def test_disk_usage_counts_every_blob_once(project: Project) -> None:
    """The sum over stages is that of the files; dropped artifacts are counted."""
    project.run("ab", "cd")
    use = project.runner().disk_usage()
    assert sum(stage.bytes for stage in use.stages.values()) == sum(path.stat().st_size for path in blobs(project))
    assert sum(stage.files for stage in use.stages.values()) == len(blobs(project))
    assert [use.stages[stage].results for stage in STAGES] == [2, 4, 4, 1]
    assert not any(row.dropped for row in use.stages.values())
    project.runner().gc(rules=Rules(drop=("split",)))
    use = project.runner().disk_usage()
    assert use.stages["split"].dropped > 0 and use.bytes > sum(row.bytes for row in use.stages.values())


def test_dropped_bytes_cannot_be_loaded(project: Project) -> None:
    """The error names the artifact."""
    report = project.run("ab")
    runner = project.runner()
    output = runner.traces.output(report.used["split"]["w0"])
    assert output is not None
    runner.gc(rules=Rules(drop=("split",)))
    with pytest.raises(LostError, match="is missing"):
        runner.load(output)
