"""Runs of a graph: cached and repeated tasks, reasons, failures and reports."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest
from toy import join, shout
from toy.values import Outside, Word
from toy_project import Project, graph, text

from runner import Graph, StoreError, UnknownNameError, UnknownShardError

FULL = {"split": 2, "shout": 4, "pair": 4, "join": 1}


@pytest.fixture
def project(tmp_path: Path) -> Project:
    return Project.make(tmp_path)


def reasons(project: Project, *words: str, **more: Any) -> dict[str, str]:
    """Map each stage to the reason of its first task that is not cached."""
    plans = project.runner().plan(graph(*words, **more), "all")
    return {plan.stage: str(plan.reason) for plan in reversed(plans) if plan.status != "cached"}


def test_tasks_run_once(project: Project) -> None:
    """A second run does no work and gives the same outputs; nested lists keep their order."""
    first = project.run("ab", "cd")
    assert project.executed() == first.ran == FULL
    assert text(project, first) == "A A C C"
    second = project.run("ab", "cd")
    assert (project.executed(), second.ran, second.cached) == ({}, {}, FULL)
    assert second.outputs == first.outputs
    assert [shard for shard, _ in second.outputs["shout"]] == ["w0/w0.0", "w0/w0.1", "w1/w1.0", "w1/w1.1"]


def test_output_of_workers_goes_to_stderr(project: Project, capfd: pytest.CaptureFixture[str]) -> None:
    """Standard output belongs to the scheduler, also below Python."""
    project.edit("toy/shout.py", '    note("shout", part.name)\n', '    note("shout", part.name)\n    os.write(1, b"a library")\n')
    assert project.run("ab", jobs=1).ok
    shown = capfd.readouterr()
    assert shown.out == "" and shown.err.count("a library") == 2


def test_a_new_element_runs_alone(project: Project) -> None:
    """A new word runs its own shards and the join."""
    project.run("ab", "cd")
    project.executed()
    project.run("ab", "cd", "ef")
    assert project.executed() == {"split": 1, "shout": 2, "pair": 2, "join": 1}


def test_a_constant_of_a_helper_runs_what_reaches_it(project: Project) -> None:
    """The stage that reaches the constant runs; stages below run only where bytes changed (the first letters did not)."""
    project.run("ab", "cd", jobs=1)
    project.executed()
    project.edit("toy/helper.py", 'MARK = "!"', 'MARK = "?"')
    assert reasons(project, "ab", "cd")["shout"] == "code changed: ~toy.helper:MARK"
    project.run("ab", "cd", jobs=1)
    assert project.executed() == {"shout": 4, "pair": 4}, "join is cut off: the first letters are the same"


def test_undo_is_free_and_a_comment_is_nothing(project: Project) -> None:
    """The old code finds its old outputs; a comment changes no code."""
    project.run("ab", jobs=1)
    project.edit("toy/helper.py", '"!"', '"?"')
    project.run("ab", jobs=1)
    project.executed()
    project.edit("toy/helper.py", '"?"', '"!"')
    project.edit("toy/helper.py", "# a comment", "# another")
    project.run("ab", jobs=1)
    assert project.executed() == {}


def test_changes_have_reasons(project: Project) -> None:
    """Each reason is from the closed list, and names the change."""
    assert reasons(project, "ab")["split"] == "first run"
    project.run("ab")
    assert reasons(project, "ab") == {}
    assert reasons(project, "ac")["split"] == "input changed: word"
    slow = shout.Params(backend="other")
    assert reasons(project, "ab", params=slow)["shout"] == 'parameter changed: backend "plain" -> "other"'
    project.edit("toy/shout.py", 'LIBRARIES = ("blake3",)', "THREADS = 2")
    assert reasons(project, "ab")["shout"] == "library version changed: blake3 \"" + _version() + "\" -> (none)"
    project.edit("toy/shout.py", "THREADS = 2", 'LIBRARIES = ("blake3",)\nTHREADS = 2')
    assert reasons(project, "ab")["shout"] == "threads changed: 1 -> 2"
    assert reasons(project, "ab")["pair"] == "upstream pending"


def _version() -> str:
    from importlib.metadata import version
    return version("blake3")


def test_explain_says_why_something_ran(project: Project) -> None:
    """A cached task has the reason of its last run; a single shard can be selected."""
    project.run("ab", "cd")
    plans = project.runner().explain(graph("ab", "cd"), "all", stage="shout", shard="w1.0")
    assert [(plan.shard, plan.status, plan.reason.why) for plan in plans] == [("w1/w1.0", "cached", "first run")]


def test_forced_stages_run_again(project: Project) -> None:
    """`force` runs a stage; equal bytes stop the stages below."""
    project.run("ab")
    project.executed()
    project.run("ab", force=["shout"])
    assert project.executed() == {"shout": 2}


def test_a_failed_shard_fails_alone_and_is_tried_again(project: Project) -> None:
    """Other shards continue, collect takes the available ones, the message is one clear line, and the traceback is kept."""
    report = project.run("ab", "bad", "bug")
    assert report.failed == {"shout": 4} and report.blocked == {"pair": 4}
    assert text(project, report) == "A A"
    messages = {failure.shard: failure.message for failure in report.failures}
    assert messages["w1/w1.0"] == "w1.0: bad words are refused"
    assert messages["w2/w2.0"] == "RuntimeError: a bug"
    kept = {row["shard"]: row for row in project.runner().failures()}
    assert "raise RuntimeError" in kept["w2/w2.0"]["traceback"]
    project.executed()
    assert project.run("ab", "bad", "bug").failed == {"shout": 4}
    assert project.executed() == {"shout": 4}, "only what failed runs again"
    project.edit("toy/shout.py", 'startswith("bad")', 'startswith("worse")')
    assert project.run("ab", "bad", jobs=1).ok


@pytest.mark.parametrize("jobs", [0, 1])
def test_a_stage_that_ends_itself_fails_alone(jobs: int, project: Project) -> None:
    """SystemExit is a failure of the shard, not the end of the run."""
    report = project.run("ab", "quit", jobs=jobs)
    assert {failure.shard for failure in report.failures} == {"w1/w1.0", "w1/w1.1"} and "SystemExit" in report.failures[0].message
    assert text(project, report) == "A A"


def test_a_collect_of_failures_is_blocked(project: Project) -> None:
    """A collect without any success is blocked, not empty."""
    report = project.run("bad")
    assert report.outputs["join"] == [] and report.blocked["join"] == 1
    assert not report.ok


def test_an_empty_list_is_collected_as_such(project: Project) -> None:
    """The result is an empty tuple, if there is neither an element nor a failure."""
    assert text(project, project.run()) == ""


def test_shards_limit_a_fan_out(project: Project) -> None:
    """Selected by the name of an outer or an inner element; an unknown name is refused with the nearest."""
    assert project.run("ab", "cd", shards=["w1"]).ran == {"split": 1, "shout": 2, "pair": 2, "join": 1}
    assert [shard for shard, _ in project.run("ab", "cd", shards=["w0.1"]).outputs["shout"]] == ["w0/w0.1"]
    assert len(project.run("ab", "cd", shards=["w0.1", "w1"]).outputs["shout"]) == 3
    with pytest.raises(UnknownShardError, match=r"unknown shard 'w2\.1'; the nearest are w[01]\.1"):
        project.run("ab", "cd", shards=["w2.1"])


def test_unknown_names_are_refused_with_the_nearest(project: Project) -> None:
    """Targets and stages."""
    with pytest.raises(UnknownNameError, match="unknown target 'al'; the nearest are all"):
        project.runner().run(graph("ab"), "al")
    with pytest.raises(UnknownNameError, match="unknown stage 'shoud'; the nearest are shout"):
        project.run("ab", force=["shoud"])


def test_run_with_only_uses_the_last_inputs_and_reports_stale_ones(project: Project) -> None:
    """One stage runs on its recorded inputs, with a note where the graph would give others."""
    with pytest.raises(UnknownNameError, match="no recorded inputs yet"):
        project.run("ab", only="shout")
    project.run("ab")
    project.executed()
    report = project.run("ab", only="shout", params=shout.Params(backend="other"))
    assert project.executed() == {"shout": 2} and report.stale == []
    stale = project.run("xy", only="shout", params=shout.Params(backend="third"))
    assert project.executed() == {"shout": 2} and len(stale.stale) == 2 and "stale" in stale.stale[0]


def test_a_plan_does_nothing(project: Project) -> None:
    """Lists tasks to run, and tasks that wait for them."""
    plans = project.runner().plan(graph("ab"), "all")
    assert [(plan.stage, plan.shard, plan.status) for plan in plans] == [
        ("split", "w0", "run"), ("shout", "w0/*", "pending"), ("pair", "w0/*", "pending"), ("join", "", "pending")]
    assert project.executed() == {}


def test_two_names_of_one_function_share_what_they_made(project: Project) -> None:
    """The key contains the function, not its name in a graph."""
    g = Graph()
    word = g.leaf("word", Word("a", "x"))
    one = g.add(join.run, words=(word,))  # type: ignore[call-arg]
    two = g.named("again").add(join.run, words=(word,))
    g.target("both", one, two)
    report = project.runner(2).run(g, "both")
    assert (report.ran, report.cached) in [({"join": 1}, {"again": 1}), ({"again": 1}, {"join": 1})]
    assert project.executed() == {"join": 1}


def test_costs_are_known_also_of_what_is_cached(project: Project) -> None:
    """CPU seconds of every shard, from its trace; costs are in no key."""
    project.run("ab")
    report = project.run("ab")
    assert set(report.cpu_s) == {("split", "w0"), ("shout", "w0/w0.0"), ("shout", "w0/w0.1"), ("pair", "w0/w0.0"),
                                 ("pair", "w0/w0.1"), ("join", "")}


def test_observers_receive_every_event(project: Project) -> None:
    """Tasks are planned, started and finished once, and progress is passed on."""
    class Watch:
        def __init__(self) -> None:
            self.seen: list[tuple[Any, ...]] = []

        def __getattr__(self, event: str) -> Any:
            return lambda *result: self.seen.append((event, *result[:2]))

    watch = Watch()
    project.run("ab", jobs=2, observer=watch)
    for event in ("planned", "started", "finished"):
        assert len([result for result in watch.seen if result[0] == event]) == 6
    assert ("progress", "join", "") in watch.seen


def test_outside_files_stay_where_they_are(project: Project, tmp_path: Path) -> None:
    """A leaf's file is not copied, its digest is remembered, and a change of it is noticed."""
    path = tmp_path / "video.bin"
    path.write_bytes(b"x" * 100_000)
    os.utime(path, ns=(10**18, 10**18))
    runner = project.runner()
    digest, size = runner.hash_file(path)
    assert size == 100_000
    tree = runner.store.put_leaf(Outside("video", digest, path))
    assert runner.files(tree)["file"] == path
    assert not list((project.store / "blobs").glob("*/" + digest[2:]))
    path.write_bytes(b"y" * 100_000)
    assert runner.hash_file(path)[0] != digest


def test_a_disk_that_is_full_is_one_sentence(project: Project) -> None:
    """The shard fails with the system's error in words; the other shards finish."""
    project.edit("toy/shout.py", "loud(part.text)", '"full disk" if part.text == "ab1" else loud(part.text)')
    report = project.run("ab", jobs=1)
    assert [(failure.shard, failure.message) for failure in report.failures] == [("w0/w0.1", "no space left on the disk")]
    assert report.ran["shout"] == 1


def test_a_store_that_cannot_be_written_is_one_sentence(tmp_path: Path) -> None:
    """The error comes before anything runs."""
    project = Project.make(tmp_path)
    project.store.write_text("a file where the store should be")
    with pytest.raises(StoreError, match="cannot be written to"):
        project.runner()


def test_code_edited_while_it_runs_is_not_stored_under_the_old_key(project: Project) -> None:
    """The output is dropped, and the shard fails with a request to run again."""
    edited_by_itself(project, "text.replace('word.text', 'word.text + str()')")
    report = project.run("ab", jobs=1)
    assert report.failures and all("was edited while the stage ran" in failure.message for failure in report.failures)


@pytest.mark.parametrize("edit", ["text + '# a comment'", "text"])
def test_an_edit_that_changes_no_code_keeps_the_output(edit: str, project: Project) -> None:
    """A comment, or the file rewritten unchanged during the run, does not discard the output."""
    edited_by_itself(project, edit)
    assert project.run("ab", jobs=1).ok
    project.executed()
    again = project.run("ab", jobs=1)
    assert again.ok and again.ran == {} and not project.executed()


def edited_by_itself(project: Project, edit: str) -> None:
    """Let the stage `pair` edit its own source while it runs."""
    code = f"text = open(FILE).read()\n    open(FILE, 'w').write({edit})"
    project.edit("toy/pair.py", 'note("pair", word.name)', f'note("pair", word.name)\n    {code}')
    project.edit("toy/pair.py", "from toy", f"FILE = {str(project.root / 'toy/pair.py')!r}\nfrom toy")
