"""Nodes with stores of their own, and the inputs that the driver pushes for them; without Ray."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from socket import socketpair

import pytest
from toy import shout
from toy_project import Project, graph

from runner.engines import MAX_GROWTH_MIB, MAX_JOBS, Inline
from runner.execute import Job, JobResult, WorkerSpec
from runner.objects import open_objects
from runner.ray_child import Channel, Executor
from runner.ray_inputs import Inputs
from runner.ray_node import Slot
from runner.segments import decode
from runner.store import prepare_store

WORDS = ("one", "two")


class Recorder(Inline):
    """Inline engine that notes the jobs of the stage `shout`."""

    jobs: list[Job]

    def submit(self, jobs: list[Job], gpus: tuple[str, ...] = ()) -> None:
        type(self).jobs += [job for job in jobs if job.spec.stage == "shout"]
        super().submit(jobs)


def jobs_of(project: Project) -> list[Job]:
    """Jobs of `shout`, which this project has run; its store holds their inputs."""
    Recorder.jobs = []
    assert project.runner(engine=Recorder).run(graph(*WORDS, params=shout.Params()), "all").ok
    return list(Recorder.jobs)


def executor(spec: WorkerSpec, store: Path) -> Executor:
    """Executor of a node whose store is at `store`."""
    return Executor({"store": str(store), "codec": spec.codec, "worker": spec.worker, "root": str(spec.root),
                     "schemas": spec.schemas, "remote": spec.remote, "session": spec.session, "owner": spec.owner, "offsets": {}})


def run(node: Executor, job: Job, *suspects: str) -> JobResult:
    return node.run(job, suspects, Channel(socketpair()[0]))


def kinds(rows: bytes) -> list[str]:
    return [row[0] for line in rows.split(b"\n")[:-1] if (row := decode(line))]


def test_the_output_of_a_lost_node_is_found_in_a_shared_store(tmp_path: Path) -> None:
    """Rows of the own run are looked up for suspects alone; others run, since a scheduler starts each key once."""
    project = Project.make(tmp_path)
    job, spec = jobs_of(project)[0], project.runner().worker_spec
    for path in (project.store / "traces").iterdir():
        path.unlink()
    lost, other = executor(spec, project.store), executor(spec, project.store)
    assert run(lost, job).status == "ran"
    assert run(other, job, job.key).status == "cached" and run(other, job).status == "ran"


def test_rows_of_a_node_stand_alone(tmp_path: Path) -> None:
    """Results name no segment, and the first one of every batch has the row of the spec."""
    project, url = Project.make(tmp_path), str(tmp_path / "remote")
    jobs, spec = jobs_of(project), project.runner(remote=url).worker_spec
    Inputs(url, project.store, "driver").push(jobs)
    node = executor(spec, tmp_path / "node")
    batches = [[replace(job, spec=replace(job.spec), force=True) for job in jobs[:1]] for _ in range(2)]
    results = [run(node, job) for batch in batches for job in (*batch, *batch)]
    assert [(result.status, result.segment, result.start) for result in results] == [("ran", "", 0)] * 4
    assert [kinds(result.rows)[0] for result in results] == ["spec", "artifact", "spec", "artifact"]


def test_an_unfinished_publication_on_a_node_is_not_a_result(tmp_path: Path) -> None:
    """A node that stored an output, and died before the remote had it, runs the task again in the next run."""
    project, url = Project.make(tmp_path), str(tmp_path / "remote")
    job = jobs_of(project)[0]
    Inputs(url, project.store, "driver").push([job])
    spec = project.runner(remote=url).worker_spec
    assert run(executor(spec, tmp_path / "node"), job).status == "ran"
    objects = open_objects(url)
    objects.delete([f"{place}/{name}" for place in ("leases", "traces") for name in objects.list(place)])
    later = project.runner(remote=url).worker_spec
    assert run(executor(later, tmp_path / "node"), job).status == "ran"
    assert run(executor(later, tmp_path / "node"), job, job.key).status == "cached"  # the claim says so


def test_a_queue_of_a_node_is_pushed_by_its_next_process(tmp_path: Path) -> None:
    """No scheduler reads that store, so the stage processes of the node empty its queue."""
    project, url = Project.make(tmp_path), str(tmp_path / "remote")
    spec, store = project.runner(remote=url).worker_spec, tmp_path / "node"
    prepare_store(store)
    node = executor(spec, store)
    assert node.place.shared is not None
    node.place.shared.remote._retry_at = float("inf")  # offline
    assert not node.place.shared.remote.publish([], b"") and list((store / "unpushed").iterdir())
    executor(spec, store)
    assert not list((store / "unpushed").iterdir())


def test_inputs_are_pushed_once_and_damaged_ones_are_moved_aside(tmp_path: Path) -> None:
    """An input that a node has reported as lost is pushed again; bytes that do not match are never shared."""
    project, url = Project.make(tmp_path), str(tmp_path / "remote")
    jobs, objects = jobs_of(project), open_objects(url)
    inputs = Inputs(url, project.store, "driver")
    inputs.push(jobs)
    names = objects.list("blobs")
    assert len(names) == len({digest for job in jobs for digest in job.inputs.values()})
    objects.delete([f"blobs/{name}" for name in names])
    inputs.push(jobs)
    assert objects.list("blobs") == []
    damaged = project.store / "blobs" / names[0]
    damaged.chmod(0o644)
    damaged.write_bytes(b"flipped")
    for job in jobs:
        inputs.forget(job)
    inputs.push(jobs)
    assert sorted(objects.list("blobs")) == sorted(names[1:]) and not damaged.exists()
    assert (project.store / "damaged" / names[0].replace("/", "")).read_bytes() == b"flipped"


@pytest.mark.parametrize(("finished", "first_mib", "resident_mib", "due"), [
    (MAX_JOBS - 1, 100.0, 100.0 + MAX_GROWTH_MIB, False), (MAX_JOBS, 100.0, 100.0, True),
    (1, 100.0, 101.0 + MAX_GROWTH_MIB, True), (0, 0.0, 0.0, False)])
def test_a_stage_process_is_due_like_one_of_the_pool(finished: int, first_mib: float, resident_mib: float, due: bool) -> None:
    """The limits are a number of jobs, and the growth since the first batch."""
    slot = object.__new__(Slot)
    slot.start = {"max_jobs": MAX_JOBS, "max_growth_mib": MAX_GROWTH_MIB}
    slot._finished, slot._first_mib, slot._resident_mib = finished, first_mib, resident_mib
    assert slot.is_due() == due
