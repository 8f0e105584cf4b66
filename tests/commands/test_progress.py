"""Progress lines of a run without a terminal."""

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


def result(capsys: pytest.CaptureFixture[str]) -> list[str]:
    return [" ".join(line.split()) for line in capsys.readouterr().err.splitlines()]


def test_a_long_task_reports_its_start_and_progress(capsys: pytest.CaptureFixture[str]) -> None:
    """A training reports its finished part, other stages their running time; short tasks of many clips only their end."""
    clock = Clock()
    lines = Lines(quiet=False, now=clock)
    for stage, shard in (("model_train", ""), ("mask_densify", "P01"), ("scene_render", "P02")):
        lines.planned(stage, shard)
        lines.started(stage, shard, Reason("first run"))
    assert result(capsys) == ["model_train started (first run)"]
    lines.progress("model_train", "", 450, 4500)
    lines.report()
    assert result(capsys) == []
    clock.seconds = BEAT_S
    lines.finished("mask_densify", "P01", "ran", 5.0, 5.0, "")
    lines.report()
    assert result(capsys) == ["mask_densify P01 5.0 s (2 known tasks left)", "model_train 10.0%, running for 30 s",
                            "scene_render P02 running for 30 s"]  # fmt: skip


def test_progress_lines_stop_with_the_run(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Lines appear during the run, and none after it."""
    monkeypatch.setattr(progress, "BEAT_S", 0.01)
    with Lines(quiet=False) as lines:
        lines.started("model_train", "", Reason("first run"))
        while not any("running for" in line for line in result(capsys)):
            sleep(0.01)
    lines._beating.join()
    result(capsys)
    assert not lines._beating.is_alive() and result(capsys) == []


def test_quiet_prints_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with Lines(quiet=True) as lines:
        lines.started("model_train", "", Reason("first run"))
        lines.finished("model_train", "", "failed", 0.0, 0.0, "no")
    assert result(capsys) == []


def test_physics_leaves_stdout_to_the_summary() -> None:
    """The last line is the JSON object; PyBullet's build time is printed elsewhere."""
    done = subprocess.run([sys.executable, "-c", "import afford.common.bullet"], cwd=ROOT, capture_output=True, text=True,
                          check=True)
    assert done.stdout == ""
