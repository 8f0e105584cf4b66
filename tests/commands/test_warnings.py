"""Warnings of a run, which a fully cached run shows as well."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from commands import run as command
from commands.session import open_runner
from commands.warnings import StageWarning, gather, show_warnings
from runner import RunReport
from tests.helpers.command import Made
from tests.helpers.tiny_source import VIDEOS

GOOD, BAD = VIDEOS


def reported(mine: Made, monkeypatch: pytest.MonkeyPatch) -> RunReport:
    """Report of one run of `recordings`."""
    seen: list[RunReport] = []
    monkeypatch.setattr(command, "show_summary", lambda *given: seen.extend(one for one in given if isinstance(one, RunReport)))
    assert mine.run("recordings").code == 0
    return seen[-1]


@pytest.fixture
def doubtful(made: Made, tmp_path: Path) -> Made:
    """Source with an unknown contact, and with images of another shape than the video, in one clip."""
    mine = made.copy(tmp_path)
    path = next(mine.source.rglob(f"{BAD}.json"))
    document = json.loads(path.read_text())
    for point in document["video_annotations"]:
        point["image"]["width"] *= 2
        for mask in point["annotations"]:
            if "hand" in mask["name"]:
                mask["in_contact_object"] = "bogus"
    path.write_text(json.dumps(document))
    return mine


def test_warnings_are_counted_and_shown_by_a_cached_run_too(
    doubtful: Made, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:
    """An unknown contact and a wrong size, for the clip that has them alone; a second run shows the same."""
    first = reported(doubtful, monkeypatch)
    runner = open_runner(doubtful.store)
    found = gather(runner, first)
    assert {(one.stage, one.shard) for one in found} == {("source_read", BAD), ("frame_decode", BAD)}
    assert any("'right hand' touches 'bogus', which is no mask" in one.text for one in found)
    assert any("320x96 against 160x96" in one.text for one in found)
    second = reported(doubtful, monkeypatch)
    assert not second.ran and gather(open_runner(doubtful.store), second) == found
    capsys.readouterr()
    assert show_warnings(runner, second) == found
    result = capsys.readouterr().err
    assert result.startswith(f"{len(found)} warning(s)") and f"source_read {BAD}: " in result and "bogus" in result


def test_a_clean_source_has_none(made: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                 capsys: pytest.CaptureFixture[str]) -> None:  # fmt: skip
    """The output is empty."""
    mine = made.copy(tmp_path)
    report, runner = reported(mine, monkeypatch), open_runner(mine.store)
    capsys.readouterr()
    assert show_warnings(runner, report) == [] and not capsys.readouterr().err


def test_many_warnings_of_one_video_are_summed_up(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """The first three are listed, the others are counted."""
    found = [StageWarning("source_read", "v", f"no {n}") for n in range(90)]
    monkeypatch.setattr("commands.warnings.gather", lambda runner, report: found)
    show_warnings(None, None)  # type: ignore[arg-type]  # not looked at
    assert capsys.readouterr().err.splitlines() == [
        "90 warning(s)", *(f"  source_read v: no {n}" for n in range(3)), "  source_read v: and 87 more"]
