"""What a run says where no terminal is: nothing runs for long in silence."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from time import sleep

import pytest

from commands import progress
from commands.progress import BEAT_S, Lines
from runner import Reason

ROOT = Path(__file__).resolve().parents[2]


class Clock:
    seconds = 0.0

    def __call__(self) -> float:
        return self.seconds


def said(capsys: pytest.CaptureFixture[str]) -> list[str]:
    return [" ".join(line.split()) for line in capsys.readouterr().err.splitlines()]


def test_a_long_task_says_that_it_starts_and_how_far_it_is(capsys: pytest.CaptureFixture[str]) -> None:
    """A training says its part; a stage that says none, how long it runs; short tasks of many clips say nothing before they end."""
    clock = Clock()
    lines = Lines(quiet=False, now=clock)
    for stage, shard in (("model_train", ""), ("mask_densify", "P01"), ("scene_render", "P02")):
        lines.planned(stage, shard)
        lines.started(stage, shard, Reason("first run"))
    assert said(capsys) == ["model_train started (first run)"]
    lines.progress("model_train", "", 450, 4500)
    lines.report()
    assert said(capsys) == []
    clock.seconds = BEAT_S
    lines.finished("mask_densify", "P01", "ran", 5.0, 5.0, "")
    lines.report()
    assert said(capsys) == ["mask_densify P01 5.0 s (2 known tasks left)", "model_train 10.0%, running for 30 s",
                            "scene_render P02 running for 30 s"]  # fmt: skip


def test_lines_come_by_themselves_while_a_run_goes_on(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """And no more after it."""
    monkeypatch.setattr(progress, "BEAT_S", 0.01)
    with Lines(quiet=False) as lines:
        lines.started("model_train", "", Reason("first run"))
        while not any("running for" in line for line in said(capsys)):
            sleep(0.01)
    lines._beating.join()
    said(capsys)
    assert not lines._beating.is_alive() and said(capsys) == []


def test_quiet_says_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with Lines(quiet=True) as lines:
        lines.started("model_train", "", Reason("first run"))
        lines.finished("model_train", "", "failed", 0.0, 0.0, "no")
    assert said(capsys) == []


def test_physics_leaves_stdout_to_the_summary() -> None:
    """Its last line is the JSON object; PyBullet prints when it was built, which goes elsewhere."""
    done = subprocess.run([sys.executable, "-c", "import afford.common.bullet"], cwd=ROOT, capture_output=True, text=True,
                          check=True)
    assert done.stdout == ""
