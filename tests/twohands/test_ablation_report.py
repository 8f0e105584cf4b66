"""The table of an ablation: means and spreads by hand, unfinished rows marked, strangers refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from afford.training.ablation import MEASURES
from maps.twohands import ROWS, recipes
from schemas.benchmark import MethodScores
from stages.twohands import ablation_report
from tests.helpers.made_samples import Scratch


def scores(name: str, iou: float) -> MethodScores:
    """Four cases: two cropped kitchens with `iou` on average, one cropped desk and one whole image that do not count."""
    values = np.full((4, len(MEASURES)), 9.0)
    values[:2] = iou
    values[0, 0], values[1, 0] = iou - 0.1, iou + 0.1
    values[1, MEASURES.index("taxonomy_accuracy")] = np.nan
    return MethodScores(
        name=name, case_id=("a", "b", "c", "d"), protocol=("cropped", "cropped", "cropped", "masks"),
        groups=(("kitchen",), ("kitchen", "new"), ("shift",), ("kitchen",)), notes=((),) * 4, measure=MEASURES, values=values,
        level=(0.5,), compat=np.zeros((4, 1, 4)), taxonomy_true=np.zeros(4, np.int8), taxonomy_found=np.zeros(4, np.int8),
        reliability=np.zeros((4, 3, 2)), sheets=())  # fmt: skip


def test_means_and_spreads(tmp_path: Path) -> None:
    """Over seeds, of the mean over cropped kitchens; one seed of two is marked, a row without any as well."""
    planned = recipes(("full", "k1", "clip"), 2)
    done = (scores("full-0", 0.5), scores("full-1", 0.7), scores("k1-0", 0.3))
    tree = ablation_report.run(planned, done[:1], ablation_report.Params(), Scratch(tmp_path), done[1:])
    metrics = json.loads(tree.find("metrics.json").path.read_text())
    assert metrics["full.iou"] == pytest.approx(0.6) and metrics["full.iou.sd"] == pytest.approx(0.2 / 2**0.5)
    assert metrics["full.taxonomy_accuracy"] == pytest.approx(0.6)
    assert (metrics["k1.iou"], metrics["k1.iou.sd"], metrics["k1.unfinished"]) == (pytest.approx(0.3), 0.0, 1.0)
    assert "clip.iou" not in metrics and metrics["clip.unfinished"] == 2.0
    lines = [line for line in tree.find("ablation.md").path.read_text().splitlines() if line.startswith("|")]
    assert [line.rpartition("| ")[2] for line in lines[-3:]] == ["2 |", "1 of 2, not finished |", "0 of 2, not finished |"]
    assert lines[-3].startswith("| full | 0.600 ± 0.141 |")


def test_rows_on_random_backbones_are_marked(tmp_path: Path) -> None:
    """A note for each of them, none for rows of their published size, and no taxonomy of a model that learns none."""
    rows = ("full", "clip", "vlm", "lisa", "extracted")
    done = tuple(scores(f"{row}-0", 0.5) for row in rows)
    tree = ablation_report.run(recipes(rows, 1), done, ablation_report.Params(), Scratch(tmp_path / "random"))
    text = tree.find("ablation.md").path.read_text()
    notes = dict(line.removeprefix("- `").rstrip(".").split("`: ") for line in text.splitlines() if line.startswith("- "))
    assert notes.keys() == {"clip", "vlm", "lisa", "extracted"}
    assert all("tiny random" in notes[row] for row in ("clip", "vlm", "lisa")) and "tiny" not in notes["extracted"]
    assert "at most 200 steps" in notes["vlm"] and notes["lisa"].endswith("learns no taxonomy")
    assert "lisa.taxonomy_accuracy" not in json.loads(tree.find("metrics.json").path.read_text()) and "| 0.500 | - | 1 |" in text
    tree = ablation_report.run(recipes(rows, 1, pretrained=True), done, ablation_report.Params(), Scratch(tmp_path / "given"))
    assert "random" not in tree.find("ablation.md").path.read_text()


def test_strangers_are_refused(tmp_path: Path) -> None:
    """Scores of another plan do not slip in."""
    with pytest.raises(ValueError, match="expected scores of full-0, got other-0"):
        ablation_report.run(recipes(("full",), 1), (scores("other-0", 0.5),), ablation_report.Params(), Scratch(tmp_path))


def test_the_plan_is_listed_without_finished_rows(tmp_path: Path) -> None:
    """A run that had too little time for a single row."""
    tree = ablation_report.run(recipes(("full", "k1"), 2), (), ablation_report.Params(), Scratch(tmp_path))
    metrics = json.loads(tree.find("metrics.json").path.read_text())
    assert metrics == {"full.seeds": 0, "full.unfinished": 2, "k1.seeds": 0, "k1.unfinished": 2}
    assert tree.find("ablation.md").path.read_text().count("0 of 2, not finished") == 2


def test_recipes_begin_with_every_row() -> None:
    """Seed 0 of all rows comes before seed 1 of any; each row changes what its name says; an unknown one is refused."""
    planned = recipes(ROWS, 2)
    assert [recipe.seed for recipe in planned] == [0] * len(ROWS) + [1] * len(ROWS)
    by = {recipe.row: recipe for recipe in planned}
    assert by["full"].text and not by["no_text"].text and by["k1"].hypotheses == 1 and by["clip"].variant == "clip"
    assert {recipe.data for recipe in planned if recipe.row != "extracted"} == {"stills"} and by["extracted"].data == "extracted"
    assert (by["hotspot"].variant, by["hotspot"].decoders, by["hotspot"].text) == ("small", 1, False)
    vlm, lisa = by["vlm"], by["lisa"]
    assert (vlm.variant, vlm.hypotheses, vlm.decoders, vlm.target, vlm.taxonomy) == ("vlm", 1, 2, "affordance", True)
    assert (lisa.variant, lisa.hypotheses, lisa.decoders, lisa.target, lisa.taxonomy) == ("vlm", 1, 1, "object", False)
    assert {row for row, recipe in by.items() if recipe.steps} == {"vlm", "lisa"}
    assert not any(recipe.steps for recipe in recipes(ROWS, 1, pretrained=True))
    with pytest.raises(ValueError, match="expected rows of full, no_text"):
        recipes(("best",), 1)
