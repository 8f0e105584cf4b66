"""Outputs whose bytes are gone: known by their traces, and computed again only when something needs them."""

from __future__ import annotations

from pathlib import Path

import pytest
from toy import join, pair, shout
from toy_project import Project, graph, text

from runner import Graph
from runner.index import Index
from tests.runner.test_healing import forms


@pytest.fixture
def project(tmp_path: Path) -> Project:
    return Project.make(tmp_path)


def remove(project: Project, *stages: str) -> None:
    """Delete the bytes of all outputs of these stages, except those that other stages have made as well."""
    runner = project.runner()
    kept = {entry.blob for trace in runner.index.all() if trace.stage not in stages
            for _, found in runner.store.closure(trace.output) if found for entry in found.files}
    for trace in list(runner.index.all()):
        for _, found in runner.store.closure(trace.output) if trace.stage in stages else ():
            for entry in found.files if found else ():
                if entry.blob not in kept:
                    runner.store.path("blobs", entry.blob).unlink(missing_ok=True)


def chain(*words: str, backend: str = "plain", wanted: str = "join") -> Graph:
    """Words -> parts -> capitals -> pairs -> one word; only one stage is wanted."""
    g = graph(*words, params=shout.Params(backend=backend))
    handles = {name: handle for handle in g.targets.pop("all") for name in [g.node_of(handle).name]}
    g.target("all", handles[wanted])
    return g


def test_missing_bytes_without_a_reader_run_nothing(project: Project) -> None:
    """Intermediates are deleted; the wanted output is there, and stays the same."""
    first = project.runner().run(chain("ab", "cd"), "all")
    remove(project, "split", "shout", "pair")
    project.executed()
    again = project.runner().run(chain("ab", "cd"), "all")
    assert again.ran == {} and again.outputs == first.outputs and not project.executed()
    assert {plan.status for plan in project.runner().plan(chain("ab", "cd"), "all")} == {"cached"}
    assert project.runner().verify().ok, "bytes without a reader are not missing"


@pytest.mark.parametrize("jobs", [0, 2])
def test_producers_run_again_for_a_task_that_must_run(jobs: int, project: Project) -> None:
    """The first letters are needed again, and so is everything that leads to them; the outputs are those of before."""
    first = project.runner().run(chain("ab"), "all")
    remove(project, "split", "shout", "pair")
    project.executed()
    report = project.runner(jobs).run(chain("ab"), "all", force=["join"])
    assert report.ok and report.outputs == first.outputs
    assert project.executed() == {"split": 1, "shout": 2, "pair": 2, "join": 1}


def test_shards_behind_a_change_run_again_alone(project: Project) -> None:
    """One word of three is new; the bytes of the other words are not computed again, except where the list needs them."""
    project.runner().run(chain("ab", "cd", "ef"), "all")
    remove(project, "split", "shout")
    project.executed()
    project.runner().run(chain("ab", "cd", "xy"), "all")
    assert project.executed() == {"split": 1, "shout": 2, "pair": 2, "join": 1}


def test_a_plan_lists_the_producers_that_would_run_again(project: Project) -> None:
    """Each has its reason; what follows from an output that stays the same is not pending."""
    project.runner().run(chain("ab"), "all")
    remove(project, "split", "shout")
    plans = project.runner().plan(chain("ab"), "all", force=["pair"])
    assert {plan.stage: (plan.status, plan.reason.why) for plan in plans} == {
        "split": ("run", "output lost"), "shout": ("run", "output lost"), "pair": ("run", "forced"),
        "join": ("pending", "upstream pending")}


def test_a_wanted_output_is_computed_again(project: Project) -> None:
    """A published value counts as wanted."""
    project.runner().run(chain("ab"), "all")
    remove(project, "join")
    assert project.runner().run(chain("ab"), "all").ran == {"join": 1}
    remove(project, "pair")
    g = chain("ab")
    node = next(node for node in g.nodes if node.sort == "pick")
    g.published.append(type("P", (), {"node": node.id})())  # type: ignore[arg-type]  # only its node is read here
    assert project.runner().run(g, "all").ran == {"pair": 2}


@pytest.mark.parametrize("form", ["collect", "straight", "pick", "pick_collect", "gather", "each"])
def test_every_form_of_edge_brings_its_bytes_back(form: str, project: Project) -> None:
    """Blobs are all deleted, so that the wanted stage must run."""
    first = project.runner().run(forms(), form)
    for path in (project.store / "blobs").glob("??/*"):
        path.unlink()
    report = project.runner().run(forms(), form)
    assert report.ok and report.outputs == first.outputs
    assert [project.runner().load(digest) for made in report.outputs.values() for _, digest in made]


def test_a_damaged_output_without_a_reader_is_repaired(project: Project) -> None:
    """Missing bytes are tolerated, wrong ones are not."""
    project.runner().run(chain("ab"), "all")
    runner = project.runner()
    output = runner.index.last("split", "w0")
    assert output is not None
    blob = next(entry.blob for _, found in runner.store.closure(output.output) if found for entry in found.files)
    place = runner.store.path("blobs", blob)
    place.chmod(0o644)
    place.write_bytes(b"wrong")
    assert project.runner().run(chain("ab"), "all").ran == {"split": 1}


def test_an_output_that_was_gone_once_is_repaired_when_it_is_damaged(project: Project) -> None:
    """The record of the loss does not hide the damage."""
    project.runner().run(chain("ab"), "all")
    remove(project, "shout")
    project.runner().run(chain("ab"), "all")
    assert project.runner().run(chain("ab"), "all", force=["pair"]).ran["shout"] == 2
    runner = project.runner()
    made = runner.index.last("shout", "w0/w0.0")
    assert made is not None and made.output in runner.index.drops
    place = runner.store.path("blobs", runner.store.manifest(made.output).files[0].blob)
    place.chmod(0o644)
    place.write_bytes(b"wrong")
    assert project.runner().run(chain("ab"), "all").ran == {"shout": 1}


def test_the_index_remembers_what_is_gone(project: Project) -> None:
    """A loss is recorded once, with the stage."""
    project.runner().run(chain("ab"), "all")
    remove(project, "shout")
    project.runner().run(chain("ab"), "all")
    gone = Index(project.store).drops
    assert len(gone) == 2 and set(gone.values()) == {"shout"}
    project.runner().run(chain("ab"), "all", force=["pair"])
    assert Index(project.store).drops == gone and text(project, project.runner().run(chain("ab"), "all")) == "A A"


def test_a_list_of_lost_elements_is_read_after_they_are_back(project: Project) -> None:
    """A stage that collects all elements waits for each of them."""
    g = Graph()
    word = g.each(g.leaf("words", tuple(__import__("toy.values").values.Word(f"w{i}", "x" * i) for i in range(1, 9))))
    loud = g.add(shout.run, part=word, word=word, params=shout.Params())
    g.target("all", g.add(join.run, words=g.collect(g.pick(g.add(pair.run, word=loud), lambda both: both.left))))  # type: ignore[call-arg]
    first = project.runner(2).run(g, "all")
    remove(project, "shout", "pair")
    project.executed()
    again = project.runner(2).run(g, "all", force=["join"])
    assert again.ok and again.outputs == first.outputs and project.executed() == {"shout": 8, "pair": 8, "join": 1}
