"""Verbs about runs: runs, runs diff, runs timeline, stale; and long plans."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from commands import store as store_verbs
from commands.run import Request, typed
from commands.timeline import PALETTE, draw_timeline, idle_spans, lanes
from runner import Reason, RunReport, TaskPlan
from runner.history import RunLog
from runner.past_runs import LoggedTask, find_run
from runner.plan_groups import group_plans
from runner.store import prepare_store
from tests.helpers.command import Made, call


def task(start: float, end: float, stage: str = "stage", result: str = "ran") -> LoggedTask:
    return LoggedTask(stage, "", result, start, end, end - start, 0.0, "first run", "")


def log_of(store: Path, stages: int, failed: bool = False) -> Any:
    """Log of a run with two tasks of every stage."""
    with RunLog(store, "dataset", {"source": "videos"}) as log:
        for number in range(stages):
            for shard in ("a", "b"):
                log.started(f"stage_{number}", shard, Reason("first run"))
                log.finished(f"stage_{number}", shard, "failed" if failed else "ran", 0.01, 0.01, "why" if failed else "")
        log.ended(RunReport("dataset"))
    return find_run(store, "last")


# -- a real run ----------------------------------------------------------------------------------------------------------


def test_a_run_is_listed(made: Made, tmp_path: Path) -> None:
    """The newest first, with target, source, settings and counts; a run with nothing to do is one of them."""
    mine = made.copy(tmp_path)
    first = mine.ask("runs", "--json", "-n", "1000", source=False).json["runs"][-1]
    assert (first["target"], first["outcome"]) == ("dataset", "ok") and first["settings"]["source"] == str(made.source)
    assert first["counts"]["ran"] == made.first["ran"]
    done = [mine.run("dataset").json for _ in range(2)]
    newest = mine.ask("runs", "--json", "-n", "2", source=False).json["runs"]
    assert [run["counts"] for run in newest] == [{"cached": run["cached"]} for run in done]
    shown = mine.ask("runs", "-n", "1000", source=False)
    places = [shown.out.index(run["id"]) for run in (*newest, first)]
    assert shown.code == 0 and places == sorted(places)
    assert "earlier run(s); -n lists more" in mine.ask("runs", "-n", "1", source=False).out
    same = mine.ask("runs", "diff", "last~1", "last", source=False)
    assert same.code == 0 and "no stage differs: both runs used the same" in same.out


def test_a_changed_parameter_is_named(made: Made, tmp_path: Path) -> None:
    """The difference has both values, the shards, and the effect on the outputs; `stale` lists the same stages before the run."""
    mine = made.copy(tmp_path)
    change = ("--set", "mask_densify.radius=7")
    stale = mine.ask("stale", "dataset", *change)
    assert "parameter changed: radius" in stale.words and "upstream pending" in stale.words
    mine.run("dataset", *change)
    assert mine.ask("stale", "dataset", *change).words.startswith("nothing to do: all")
    shown = mine.ask("runs", "diff", "last~1", "last", source=False).out
    assert "mask_densify\n  parameters: radius" in shown and "-> 7" in shown and "--sets: (none) -> mask_densify.radius=7" in shown
    found = mine.ask("runs", "diff", "last~1", "last", "--json", source=False).json["stages"]
    assert "mask_densify" in {stage["stage"] for stage in found} and "frame_decode" not in {stage["stage"] for stage in found}
    for suffix in ("svg", "png"):
        out = tmp_path / f"timeline.{suffix}"
        assert mine.ask("runs", "timeline", "--out", out, source=False).code == 0 and out.stat().st_size > 10_000


def test_stale_lists_no_task_after_a_run(made: Made) -> None:
    """One sentence, and an empty list as JSON."""
    done = made.ask("stale", "dataset")
    assert done.code == 0 and done.out.startswith("nothing to do: all ")
    assert made.ask("stale", "dataset", "--json").json["stale"] == []


# -- errors --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("words", "message"), [
    (("diff", "last", "zz"), "run 'zz' is unknown; list the ids with `runs`"),
    (("diff", "last", "last~99999"), "unknown run 'last~99999'"),
    (("timeline", "zz", "--out", "x.svg"), "run 'zz' is unknown"),
    (("timeline", "last", "--out", "x.jpg"), "--out x.jpg: the name must end in .svg or .png"),
])  # fmt: skip
def test_errors_are_one_sentence(words: tuple[str, ...], message: str, made: Made) -> None:
    """Exit 2."""
    refused = made.ask("runs", *words, source=False)
    assert refused.code == 2 and message in refused.err and refused.err.count("\n") == 1


def test_an_empty_history_is_no_error_for_the_list(tmp_path: Path) -> None:
    """The list is empty; a difference and a picture need a run."""
    prepare_store(tmp_path / "store")
    shown = call("runs", "--store", tmp_path / "store")
    assert (shown.code, shown.out) == (0, "no recorded run yet\n")
    for words in (("diff", "last", "last"), ("timeline", "last")):
        refused = call("runs", *words, "--store", tmp_path / "store")
        assert refused.code == 2 and "has no recorded run yet; record one with `run`" in refused.err


def test_a_run_without_tasks_cannot_be_drawn(tmp_path: Path) -> None:
    """A run with cached tasks alone is refused with exit code 2."""
    prepare_store(tmp_path)
    log_of(tmp_path, 0)
    refused = call("runs", "timeline", "--store", tmp_path, "--out", tmp_path / "x.svg")
    assert refused.code == 2 and "executed no task" in refused.err


# -- settings ------------------------------------------------------------------------------------------------------------


def test_settings_are_recorded_as_typed() -> None:
    """Those that differ from their defaults, as plain JSON."""
    request = Request("dataset", Path("videos"), ("P01",), ("a.b=1",), minutes=3.0)
    assert typed(request) == {"source": "videos", "clips": ["P01"], "sets": ["a.b=1"], "minutes": 3.0}
    assert json.loads(json.dumps(typed(request))) == typed(request) and typed(Request("dataset")) == {}


# -- the picture ---------------------------------------------------------------------------------------------------------


def test_lanes_hold_one_task_at_a_time() -> None:
    """Lanes are as many as tasks at a time; a lane that is free is used again."""
    bars = lanes([task(0, 4), task(1, 2), task(2, 3), task(2.5, 5), task(4, 6)])
    assert [bar.lane for bar in bars] == [0, 1, 1, 2, 0]
    for lane in range(3):
        mine = [bar.task for bar in bars if bar.lane == lane]
        assert all(one.end <= two.start for one, two in pairwise(mine))


def test_idle_time_is_found() -> None:
    """Time without any task, between the first and the last."""
    assert idle_spans([task(0, 1), task(3, 5), task(4, 4.5), task(5.5, 6)]) == [(1, 3), (5, 5.5)]
    assert idle_spans([]) == idle_spans([task(0, 1)]) == []


@pytest.mark.parametrize("stages", [1, 30, 40])
def test_every_stage_has_a_look_of_its_own(tmp_path: Path, stages: int) -> None:
    """A picture of a run with many stages, of failed tasks as well, holds the name of each in its legend."""
    out = tmp_path / "timeline.svg"
    draw_timeline(log_of(tmp_path, stages, failed=stages == 1), out)
    text = out.read_text()
    assert all(f"stage_{number} " in text for number in range(stages)) and len(set(PALETTE)) == 30
    assert "run dataset" in text


# -- long plans ----------------------------------------------------------------------------------------------------------


def test_plans_are_grouped() -> None:
    """Groups are those of stage, state and reason, with counts and the first shards."""
    plans = [TaskPlan("one", f"s{number}", "run", Reason("code changed", "a:b")) for number in range(1000)]
    plans += [TaskPlan("one", "x", "cached", Reason("first run")), TaskPlan("two", "", "pending", Reason("upstream pending"))]
    groups = group_plans(plans)
    assert [(group.stage, group.status, group.reason, group.count) for group in groups] == [
        ("one", "run", "code changed: a:b", 1000), ("one", "cached", "first run", 1), ("two", "pending", "upstream pending", 1)]
    assert groups[0].shards == ["s0", "s1", "s2"]


def test_a_long_explanation_is_grouped(made: Made, monkeypatch: pytest.MonkeyPatch) -> None:
    """Above the limit, unless all tasks are wanted; JSON has all of them."""
    short = made.ask("explain").out
    monkeypatch.setattr(store_verbs, "MANY_TASKS", 5)
    grouped = made.ask("explain").out
    count = len(made.ask("explain", "--json").json["tasks"])
    assert f"{count} tasks, grouped; --all lists each" in grouped and len(grouped.splitlines()) < len(short.splitlines())
    assert made.ask("explain", "--all").out == short
