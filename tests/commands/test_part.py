"""Laws of parts: an output of less than there is never takes the place of a whole one unless that is asked for."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from commands.outputs import Publisher, partial_outputs
from commands.session import open_runner
from maps.settings import Origin, Settings
from pipeline import build
from runner import Failure, Runner, RunReport
from tests.helpers.command import KEYS, Made
from tests.helpers.made_files import artifact, content
from tests.helpers.tiny_source import VIDEOS, media

WHOLE = json.dumps({"videos": 5, "splits": {"train": 287, "val": 69}})
FEWER = [{"videos": 4, "splits": {"train": 287, "val": 69}}, {"videos": 5, "splits": {"train": 287}}]


@pytest.fixture
def mine(made: Made, tmp_path: Path) -> Made:
    return made.copy(tmp_path)


@pytest.fixture
def runner(tmp_path: Path) -> Runner:
    return open_runner(tmp_path / "store", jobs=0)


@pytest.fixture
def whole(runner: Runner, tmp_path: Path) -> Path:
    """A published data set of five videos and two splits."""
    folder = runner.store.root / "datasets" / "set"
    digest = artifact(runner, tmp_path / "whole", **{"statistics.json": WHOLE})
    assert Publisher(runner).folder("dataset_pack", digest, folder) == str(folder)
    return folder


# -- from the command line ---------------------------------------------------------------------------------------------


def test_a_run_of_some_clips_leaves_the_whole_data_set(mine: Made) -> None:
    """It is published as a part, which one line says; a whole run says nothing of the kind."""
    data = mine.store / "datasets" / mine.source.name
    part, before = data.with_name(f"{data.name}-part"), content(data)
    said = mine.run("dataset", "--clip", VIDEOS[0])
    assert said.code == 0 and content(data) == before
    assert said.json["outputs"]["dataset"] == str(part) and json.loads(content(part)["statistics.json"])["videos"] == 1
    assert len(said.json["notes"]) == 1 and said.json["notes"][0] in said.words and f"made of {VIDEOS[0]} alone" in said.words
    assert (mine.store / "recordings" / mine.source.name / "dataset_pack-part.mcap").exists()
    again = mine.run("dataset").json
    assert again.keys() == KEYS and again["outputs"]["dataset"] == str(data) and content(data) == before


def test_a_part_takes_the_place_of_the_whole_when_that_is_asked_for(mine: Made) -> None:
    """From then on it is the whole: to publish the same again changes nothing."""
    data = mine.store / "datasets" / mine.source.name
    for more in (["--replace"], []):
        said = mine.run("dataset", "--clip", VIDEOS[0], *more).json
        assert said["outputs"]["dataset"] == str(data) and "notes" not in said
        assert json.loads(content(data)["statistics.json"])["videos"] == 1 and not data.with_name(f"{data.name}-part").exists()


def test_a_run_without_the_clips_that_failed_is_a_part(mine: Made) -> None:
    """Of a video that the reader refuses, too, and also where there is no whole one yet."""
    media(mine.source, VIDEOS[0]).write_bytes(b"")
    data = mine.store / "datasets" / mine.source.name
    for name in sorted(path for path in data.rglob("*") if path.is_file()):
        name.unlink()
    said = mine.run("dataset")
    assert said.code == 1 and said.json["outputs"]["dataset"] == f"{data}-part"
    assert "1 of the tasks behind it failed" in said.words


# -- what is a part ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("fewer", FEWER, ids=["videos", "splits"])
def test_a_data_set_of_less_stands_beside_the_one_of_more(
    fewer: dict[str, object], runner: Runner, whole: Path, tmp_path: Path,
) -> None:
    """Whatever the run was; one of as much takes its place."""
    digest = artifact(runner, tmp_path / "fewer", **{"statistics.json": json.dumps(fewer)})
    to = Publisher(runner)
    assert to.folder("dataset_pack", digest, whole) == f"{whole}-part" and content(whole) == {"statistics.json": WHOLE.encode()}
    assert len(to.notes) == 1 and "--replace" in to.notes[0]
    record = artifact(runner, tmp_path / "mcap", x="x")
    assert to.file("record_dataset_pack", record, whole / "x.mcap") == str(whole / "x-part.mcap")
    assert Publisher(runner, replace=True).folder("dataset_pack", digest, whole) == str(whole)
    back = artifact(runner, tmp_path / "back", **{"statistics.json": WHOLE + "\n"})
    assert Publisher(runner).folder("dataset_pack", back, whole) == str(whole)


@pytest.mark.parametrize("there", ["{", "[]", '{"videos": "many", "splits": 3}'])
def test_what_cannot_be_read_is_replaced(there: str, runner: Runner, whole: Path, tmp_path: Path) -> None:
    """Nothing is known to be lost."""
    (whole / "statistics.json").unlink()
    (whole / "statistics.json").write_text(there)
    digest = artifact(runner, tmp_path / "fewer", **{"statistics.json": json.dumps(FEWER[0])})
    assert Publisher(runner).folder("dataset_pack", digest, whole) == str(whole)


def test_a_table_that_is_not_finished_grows_and_never_shrinks(runner: Runner, tmp_path: Path) -> None:
    """Of a run that ends after some time."""
    reports = runner.store.root / "reports" / "table"
    few, more = (artifact(runner, tmp_path / str(n), **{"metrics.json": json.dumps(dict.fromkeys(map(str, range(n)), 0.5))})
                 for n in (1, 2))  # fmt: skip
    for digest, name in ((few, "table"), (more, "table"), (few, "table-part"), (more, "table")):
        assert Publisher(runner, unfinished=True).folder("sor3d_report", digest, reports) == str(reports.with_name(name))
    assert Publisher(runner).folder("sor3d_report", few, reports) == str(reports)


def test_outputs_that_stand_side_by_side_are_parts_together(runner: Runner, tmp_path: Path) -> None:
    """As the columns of a comparison, one of which failed."""
    folder, stages = tmp_path / "set-compare", ("report_flow", "report_nearest")
    to = Publisher(runner, {"report_nearest": "1 of the tasks behind it failed"})
    assert to.together(stages, folder) == tmp_path / "set-compare-part" and "set-compare-part is partial" in to.notes[0]
    assert Publisher(runner, to.why, replace=True).together(stages, folder) == Publisher(runner).together(stages, folder) == folder


def test_only_failures_that_feed_an_output_make_it_a_part() -> None:
    """A recording that could not be written takes no sample away."""
    g = build("dataset", Origin("some"), Settings())
    for stage, is_part in (("frame_decode", True), ("dataset_pack", True), ("record_frame_decode", False)):
        report = RunReport("some", failures=[Failure(stage, "", "no")], outputs={"dataset_pack": []})
        assert bool(partial_outputs(g, report, (), 0)) is is_part
    report = RunReport("some", outputs={"dataset_pack": []})
    assert partial_outputs(g, report, ("P96_01",), 0) == {"dataset_pack": "made from P96_01 alone"}
