"""Store maintenance: lineage, verify, gc, provenance."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest
from toy import shout
from toy_project import Project, text

from runner import StoreError
from runner.lease import Lease


@pytest.fixture
def project(tmp_path: Path) -> Project:
    return Project.make(tmp_path)


def test_lineage_leads_to_the_leafs(project: Project) -> None:
    """A digest, a prefix of it or a path leads through every stage to values from outside."""
    report = project.run("ab")
    digest = report.outputs["join"][0][1]
    runner = project.runner()
    origin = runner.lineage(digest)
    stages, todo = [], [origin]
    while todo:
        at = todo.pop()
        stages.append(at.trace.stage if at.trace else at.kind)
        todo += [source for _, source in at.inputs]
    assert {"join", "pair", "shout", "split", "Word"} <= set(stages)
    assert runner.lineage(digest[:16]) == origin
    blob = runner.store.path("blobs", runner.store.manifest(digest).files[0].blob)
    assert runner.lineage(str(blob)).digest == digest
    with pytest.raises(ValueError, match="matches 0 artifacts"):
        runner.lineage("zz")


def test_provenance_is_complete(project: Project) -> None:
    """A trace has key, inputs, parameters, code, seed, versions, machine and cost."""
    report = project.run("ab")
    trace = project.runner().lineage(report.outputs["shout"][0][1]).trace
    assert trace is not None and trace.stage == "shout" and trace.shard == "w0/w0.0"
    assert set(trace.inputs) == {"part", "word"} and trace.params["fields"]["backend"] == "plain"
    assert trace.libraries.keys() == {"blake3"} and trace.threads == 1 and trace.machine and trace.seed
    assert (project.store / "code" / f"{trace.code}.json").exists()


def test_gc_keeps_what_is_in_use(project: Project) -> None:
    """Outputs of unused parameters are deleted; those in use stay, and nothing runs again."""
    project.run("ab", params=shout.Params(backend="old"))
    project.edit("toy/helper.py", '"!"', '"?"')
    report = project.run("ab", jobs=1)
    project.executed()
    before = sum(1 for _ in (project.store / "blobs").glob("??/*"))
    swept = project.runner().gc()
    assert swept.files > 0 and swept.bytes > 0
    assert sum(1 for _ in (project.store / "blobs").glob("??/*")) < before
    assert project.runner().gc().files == 0
    assert project.run("ab").ran == {} and text(project, report) == "A A"
    assert project.runner().verify().ok


def test_gc_waits_for_no_run_and_disturbs_none(project: Project) -> None:
    """Garbage collection is refused in one sentence during a run."""
    project.run("ab")
    lease = Lease(project.store / "leases" / "store.lock", shared=True)
    with pytest.raises(StoreError, match="a run is using"):
        project.runner().gc()
    lease.release(remove=False)
    project.runner().gc()


def test_blobs_are_read_only(project: Project) -> None:
    """Accidental edits fail."""
    project.run("ab")
    for path in (project.store / "blobs").glob("??/*"):
        assert stat.S_IMODE(os.stat(path).st_mode) == 0o444


def test_scratch_is_gone_when_the_output_is_safe(project: Project) -> None:
    """Leases are gone as well."""
    project.run("ab", jobs=2)
    assert list((project.store / "scratch").iterdir()) == []
    assert {path.name for path in (project.store / "leases").iterdir()} <= {"store.lock", "keys.lock"}


def test_gc_keeps_what_was_used_last_also_when_another_run_was_open(project: Project) -> None:
    """An edit that ran and was undone while another run was open does not count as the last use."""
    project.run("ab")
    open_run = project.runner()
    project.edit("toy/helper.py", '"!"', '"?"')
    project.run("ab")
    project.edit("toy/helper.py", '"?"', '"!"')
    project.run("ab")
    open_run.traces.use("another stage", "", "0" * 64)
    open_run.traces.save()
    project.runner().gc()
    project.executed()
    assert project.run("ab").ran == {} and not project.executed()


def test_the_last_use_is_known_without_the_index(project: Project) -> None:
    """Older traces are current after an undo; gc keeps them although .cache is gone."""
    project.run("ab")
    project.edit("toy/helper.py", '"!"', '"?"')
    project.run("ab")
    project.edit("toy/helper.py", '"?"', '"!"')
    project.run("ab")
    (project.store / ".cache" / "index.json").unlink(missing_ok=True)
    project.runner().gc()
    assert project.run("ab").ran == {}


def test_a_dry_gc_counts_and_deletes_nothing(project: Project) -> None:
    """Files and bytes equal those that the real one deletes."""
    project.run("ab", params=shout.Params(backend="old"))
    project.run("ab")

    def stored() -> set[str]:
        files = {path.name for room in ("blobs", "code") for path in (project.store / room).rglob("*")}
        return files | set(project.runner().index.keys())

    before = stored()
    dry = project.runner().gc(dry_run=True)
    assert stored() == before and dry.traces > 0
    swept = project.runner().gc()
    assert (swept.files, swept.bytes) == (dry.files, dry.bytes) and stored() < before


def test_gc_sees_what_a_run_finished_while_it_waited(project: Project) -> None:
    """A runner that was opened before another run ended finds its results when it collects."""
    collector = project.runner()
    project.run("ab")
    collector.gc()
    assert project.run("ab").ran == {}
