"""Comparison of outputs before and after a change by `benchmarks/pin_outputs.py`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks.pin_outputs import NAMES_CODE, PINNED, RUNS, compare, request
from benchmarks.pin_sources import SOURCES, written
from commands.settings import settings
from commands.target_graphs import graph_of_request
from commands.targets import ALL
from pipeline import TARGETS
from runner.canonical import file_digest

BEFORE = {"read": {"a": "1", "b": "2"}, "model_train": {"": "3"}}


def test_equal_outputs_are_counted() -> None:
    found = compare(BEFORE, BEFORE)
    assert (found.equal, found.different, found.renamed) == (3, [], [])


def test_a_stage_with_another_name_is_renamed_and_not_different() -> None:
    found = compare(BEFORE, {"read": BEFORE["read"], "sor3d_train": {"": "3"}})
    assert (found.equal, found.different, found.renamed) == (3, [], ["model_train -> sor3d_train"])


def test_a_stage_that_differs_is_named_with_its_shards() -> None:
    found = compare(BEFORE, {"read": {"a": "1", "b": "9"}, "model_train": {"": "3"}}, lambda before, now: f"{before} {now}")
    assert (found.equal, found.different) == (2, ["read: 1 of 2: b (2 9)"])


def test_removed_and_new_outputs_differ() -> None:
    found = compare(BEFORE, {"read": {"a": "1"}, "other": {"": "4"}})
    assert found.different == ["read: 1 of 2: b", "model_train: gone", "other: new"]
    assert compare({}, BEFORE).different == ["read: new", "model_train: new"]


def test_targets_are_pinned() -> None:
    assert set(TARGETS) - {ALL} == {run.target for run in RUNS.values()}
    pinned = json.loads(PINNED.read_text())["targets"]
    assert list(pinned) == list(RUNS)
    assert {stage for row in pinned.values() for stage in row["outputs"]} >= NAMES_CODE.keys()


@pytest.mark.parametrize("name", RUNS)
def test_settings_of_a_run_fit_its_target(name: str, tmp_path: Path) -> None:
    """The command line accepts the settings of every run."""
    asked = request(RUNS[name], tmp_path)
    graph, *_ = graph_of_request(asked.target, asked.source, (), asked.sets, {"": settings(asked.sets, None)}, file_digest)
    assert graph.targets


@pytest.mark.parametrize("name", SOURCES)
def test_a_source_has_the_same_bytes_each_time(name: str, tmp_path: Path) -> None:
    files = [{path.relative_to(at): path.read_bytes() for path in sorted(written(name, at).rglob("*")) if path.is_file()}
             for at in (tmp_path / "one", tmp_path / "two")]  # fmt: skip
    assert files[0] == files[1] and files[0]
