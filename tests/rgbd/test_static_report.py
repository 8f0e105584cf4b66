"""Table of several models on the same pictures, in the order of their reports."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from afford.common.files import tree, write_json
from afford.rgbd.evaluate.static_table import FIGURES
from schemas.files import FileTree
from stages.rgbd import static_report
from tests.helpers.made_samples import Scratch


def report(root: Path, name: str, **figures: float) -> FileTree:
    """Report of static_evaluate with figures that the table does not show."""
    folder = root / name
    folder.mkdir()
    write_json(folder / "metrics.json", {"iou": 0.25, "f": 0.4, "fw": 0.35, "closed.iou": 0.5, "iou.grasp": 0.1} | figures)
    return tree(name, folder)


def test_table_has_a_line_per_method_and_two_of_the_paper(tmp_path: Path) -> None:
    """Lines in the order of the reports."""
    given = report(tmp_path, "static_sor3d"), report(tmp_path, "static_boxes", iou=0.125), report(tmp_path, "mine")
    made = static_report.run(given, static_report.Params("umd"), Scratch(tmp_path / "out"))
    numbers = json.loads(made.find("metrics.json").path.read_text())  # type: ignore[union-attr]  # it is there
    assert len(numbers) == 3 * len(FIGURES) and (numbers["static_boxes.iou"], numbers["mine.closed.iou"]) == (0.125, 0.5)
    lines = made.find("report.md").path.read_text().splitlines()  # type: ignore[union-attr]  # it is there
    rows = [line for line in lines if line.startswith("| ") and "IoU" not in line]
    assert rows[:3] == ["| the model of sequences | 0.250 | 0.400 | 0.350 | 0.500 |",
                        "| detector, its own boxes | 0.125 | 0.400 | 0.350 | 0.500 |", "| mine | 0.250 | 0.400 | 0.350 | 0.500 |"]
    assert [row.split(" | ")[1] for row in rows[3:]] == ["0.54", "0.56"] and lines[0].endswith("umd")


def test_a_report_without_figures_is_refused(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty" / "report.md").touch()
    for bad in (tree("empty", tmp_path / "empty"), FileTree("none", ())):
        with pytest.raises(ValueError, match=f"{bad.name}: expected metrics.json with iou"):
            static_report.run((bad,), static_report.Params(), Scratch(tmp_path / "out"))
