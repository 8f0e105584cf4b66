"""Inputs that turn out damaged when a task reads them: the producer runs again, then the task, through every form of edge."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

import pytest
from toy import join, pair, shout, split
from toy.values import Word
from toy_project import Project, text

from runner import Graph
from runner.execute import Job, JobResult
from runner.report import SilentObserver
from runner.walk import PlanListener, Walk
from tests.runner.test_crashes import flip


@pytest.fixture
def project(tmp_path: Path) -> Project:
    return Project.make(tmp_path)


def forms() -> Graph:
    """Graph with a consumer at the end of each form of edge: direct, picked field, list, tuple of handles, element."""
    g = Graph()
    word = g.leaf("word", Word("w", "ab"))
    parts = g.add(split.run, word=word, params=split.Params())
    part = g.each(parts)
    loud = g.add(shout.run, part=part, word=word, params=shout.Params())
    both = g.add(pair.run, word=loud)
    g.target("collect", g.named("join_collect").add(join.run, words=g.collect(loud)))  # type: ignore[call-arg]
    g.target("straight", g.named("pair_again").add(pair.run, word=loud))
    g.target("pick", g.named("shout_pick").add(shout.run, part=g.pick(both, lambda b: b.left), word=word, params=shout.Params()))
    picked = g.collect(g.pick(both, lambda b: b.right))
    g.target("pick_collect", g.named("join_picked").add(join.run, words=picked))  # type: ignore[call-arg]
    first = g.named("shout_first").add(shout.run, part=word, word=word, params=shout.Params())
    second = g.named("pair_first").add(pair.run, word=first)
    halves = (g.pick(second, lambda b: b.left), g.pick(second, lambda b: b.right), first)
    g.target("gather", g.named("join_gather").add(join.run, words=halves))  # type: ignore[call-arg]
    g.target("each", loud)
    return g


CONSUMERS = {"collect": "join_collect", "straight": "pair_again", "pick": "shout_pick", "pick_collect": "join_picked",
             "gather": "join_gather", "each": "shout"}  # fmt: skip


@pytest.mark.parametrize("jobs", [0, 2])
@pytest.mark.parametrize("form", CONSUMERS)
def test_a_damaged_input_is_made_again_and_its_consumer_runs(form: str, jobs: int, project: Project) -> None:
    """The cache reports every blob as valid, as after damage during a run; the outputs are still right."""
    first = project.runner(jobs).run(forms(), form)
    runner = project.runner(jobs)
    runner.store._verified_blobs.same = lambda blob, found: found.st_size > 0  # type: ignore[method-assign]
    for path in sorted((project.store / "blobs").glob("??/*")):
        flip(path)
    report = runner.run(forms(), form, force=[CONSUMERS[form]])
    assert report.ok and report.outputs == first.outputs and report.ran[CONSUMERS[form]] >= 1
    loaded = [project.runner().load(digest) for made in report.outputs.values() for _, digest in made]
    assert loaded and project.runner(jobs).run(forms(), form).outputs == first.outputs


def test_a_list_whose_manifest_is_gone_is_listed_again(project: Project) -> None:
    """The list has no producing stage, and is rebuilt from its elements."""
    first = project.runner().run(forms(), "collect")
    runner = project.runner()
    trace = runner.index.last("join_collect", "")
    assert trace is not None
    for path in (project.store / "traces").iterdir():
        rows = [line for line in path.read_bytes().splitlines(True) if f'"artifact","{trace.inputs["words"]}'.encode() not in line]
        path.write_bytes(b"".join(rows))
    report = project.runner().run(forms(), "collect", force=["join_collect"])
    assert report.ok and report.outputs == first.outputs and project.runner().store.find(trace.inputs["words"]) is not None


@pytest.mark.parametrize("jobs", [0, 2])
def test_a_list_that_another_run_stored_meanwhile_is_known_to_this_one(jobs: int, project: Project) -> None:
    """Two runs make the same list, such as an empty one, under different keys."""
    other = Graph()
    other.target("parts", other.add(split.run, word=other.leaf("word", Word("other", "x")), params=split.Params(parts=0)))

    class Meanwhile(SilentObserver):
        def finished(self, stage: str, *_: object) -> None:
            if stage == "shout":
                assert project.runner().run(other, "parts").ok

    g = Graph()
    word = g.leaf("word", Word("w", "ab"))
    parts = g.add(split.run, word=g.add(shout.run, part=word, word=word, params=shout.Params()), params=split.Params(parts=0))
    g.target("joined", g.add(join.run, words=parts))  # type: ignore[call-arg]
    report = project.runner(jobs).run(g, "joined", observer=Meanwhile())
    assert report.ok and report.ran == {"shout": 1, "split": 1, "join": 1} and text(project, report) == ""


def test_an_input_that_stays_unreadable_ends_the_task(project: Project, monkeypatch: pytest.MonkeyPatch) -> None:
    runner = project.runner()
    monkeypatch.setattr(runner.store, "lost", lambda digest: [digest])
    report = runner.run(forms(), "straight")
    assert [one.stage for one in report.failures] == ["split"] and "computed again 3 times" in report.failures[0].message


def test_a_task_that_runs_again_is_planned_again(project: Project) -> None:
    """Otherwise a progress display would count below nothing."""
    class Count(SilentObserver):
        planned_, finished_ = 0, 0

        def planned(self, *_: object) -> None:
            self.planned_ += 1

        def finished(self, *_: object) -> None:
            self.finished_ += 1

    count = Count()
    project.runner().run(forms(), "collect")
    runner = project.runner()
    runner.store._verified_blobs.same = lambda blob, found: found.st_size > 0  # type: ignore[method-assign]
    for path in sorted((project.store / "blobs").glob("??/*")):
        flip(path)
    assert runner.run(forms(), "collect", force=["join_collect"], observer=count).ok
    assert count.planned_ == count.finished_ > 1


def test_an_outcome_that_is_withdrawn_is_not_propagated(project: Project) -> None:
    """A reader finds an output damaged before the walk has propagated it."""
    graph, runner = forms(), project.runner()
    assert runner.run(graph, "each").ok
    listener = PlanListener(runner._task_planner(()))
    walk = listener.walk = Walk(graph, [graph.node_of(handle) for handle in graph.targets["each"]], listener._planner, listener)
    walk.begin()
    split = next(node for node in graph.stages() if node.name == "split")
    digest = walk.outcome[split.id, ()]
    walk.publish(split, (), digest)
    assert walk.reopen(digest) == {(split.id, ()): True}
    walk.follow()
    assert (split.id, ()) not in walk.outcome


class ScriptedEngine:
    """Engine that answers each round of jobs by a function of the running jobs."""

    def __init__(self, *rounds: Callable[[list[Job]], list[JobResult]]) -> None:
        self.rounds, self.jobs = list(rounds), list[Job]()

    own_placement, window = False, 1

    def submit(self, jobs: list[Job], gpus: tuple[str, ...] = ()) -> None:
        """Queue the jobs."""
        self.jobs += jobs

    def wait(self, patience_s: float) -> list[tuple[str, str, object]]:
        """Results of the next round; the last one repeats."""
        results = (self.rounds.pop(0) if len(self.rounds) > 1 else self.rounds[0])(self.jobs)
        ended = {result.key for result in results}
        self.jobs = [job for job in self.jobs if job.key not in ended]
        return [("done", result.key, result) for result in results]


def test_a_producer_runs_again_for_a_loss_that_is_reported_after_its_result(project: Project) -> None:
    """A second reader reports damage in the round in which the output is computed again for the first reader."""
    first = project.runner().run(forms(), "each")
    runner = project.runner(2)
    traces = {trace.key: trace for trace in runner.traces.all()}
    away = project.store / "away"

    def lost(job: Job) -> JobResult:
        return JobResult(job.key, "lost", message=traces[job.key].inputs["part"])

    def ran(jobs: list[Job]) -> list[JobResult]:
        return [JobResult(job.key, "ran", traces[job.key].output) for job in jobs]

    def first_loss(jobs: list[Job]) -> list[JobResult]:
        (project.store / "blobs").rename(away)
        return [lost(jobs[0])]

    def result_and_second_loss(jobs: list[Job]) -> list[JobResult]:
        away.rename(project.store / "blobs")
        return [*ran(jobs[1:]), lost(jobs[0])]

    engine = ScriptedEngine(first_loss, result_and_second_loss, ran)
    runner._session = lambda: nullcontext(engine)  # type: ignore[method-assign]
    report = runner.run(forms(), "each", force=["shout"])
    assert report.ok and report.outputs == first.outputs and report.ran["split"] == 1


def test_a_missing_wanted_output_is_a_failure(project: Project, monkeypatch: pytest.MonkeyPatch) -> None:
    """No run succeeds without its output, whatever the cause."""
    monkeypatch.setattr("runner.schedule.Schedule.needed", lambda *_: None)
    report = project.runner().run(forms(), "gather")
    assert not report.ok and {failure.stage for failure in report.failures} == {"join_gather"}
