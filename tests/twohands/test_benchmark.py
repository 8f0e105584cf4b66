"""The whole comparison: what the report holds, how its numbers are called, and what runs again when something changes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from afford.twohands.benchmark import tables
from afford.twohands.benchmark.score import MEASURES
from runner import RunReport
from schemas.benchmark import MethodScores
from tests.helpers import made_comparison
from tests.helpers.made_comparison import ROOT

METHODS = ("small", "small_text_shuffled", "small_text_removed", "whole_object", "object_box", "centre", "class_mean",
           "small_swapped", "lisa")  # fmt: skip


@pytest.fixture(scope="module")
def report(compared: tuple[Path, RunReport]) -> dict[str, Path]:
    """The files of the report by name."""
    from afford.codecs import CODEC
    from runner.store import Store

    store, ran = compared
    assert ran.ok, ran.failures
    ((_, digest),) = ran.outputs["benchmark"]
    return {ref.name: ref.path for ref in Store(store, CODEC).load(digest).files}


def test_metrics_of_all_methods(report: dict[str, Path]) -> None:
    """`small.iou` and other measures, in kitchens of the cropped set; other groups, whole images and compat under prefixes."""
    metrics = json.loads(report["metrics.json"].read_text())
    for name in ("small.iou", "small.precision", "small.hd_px", "small.map", "small.taxonomy_accuracy", "whole_object.iou",
                 "whole_object.precision", "shift.small.iou", "masks.small.iou", "epic.small.hand_iou", "compat.all.lisa.map",
                 "small.iou.low", "small.iou.high", "small.best_mode_iou", "unseen_kind.small.ece", "cases"):  # fmt: skip
        assert name in metrics, name
    assert {name for name in METHODS if f"all.{name}.iou" in metrics} == set(METHODS)
    assert metrics["small.iou.low"] <= metrics["small.iou"] <= metrics["small.iou.high"] and metrics["cases"] == 8


def test_the_report_can_be_read_and_looked_at(report: dict[str, Path]) -> None:
    """Markdown with every method and the published row, LaTeX, plots, a sheet per method and protocol."""
    text = report["report.md"].read_text()
    assert all(f"| {name} |" in text for name in METHODS)
    assert "| AffExtract (2HandedAfforder, ActAffordance) | 0.185 | 0.420 |" in text
    assert "taxonomy disagrees | 1 |" in text and "## Methods: Kitchens, cropped to the objects, 4 cases" in text
    latex = report["tables.tex"].read_text()
    assert "small\\_text\\_removed" in latex and latex.count("\\begin{tabular}") == latex.count("\\bottomrule")
    assert {"plots/scores.png", "plots/reliability.png", "sheets/small_cropped.jpg", "sheets/lisa_masks.jpg"} <= set(report)


def test_the_same_again_runs_nothing_and_another_measure_predicts_nothing(
        compared: tuple[Path, RunReport], tmp_path: Path) -> None:  # fmt: skip
    """Predictions do not hang on the parameters of the scores."""
    from maps.settings import Origin, Settings
    from maps.twohands import benchmark_report
    from runner import Graph, Runner
    from stages.twohands import benchmark, score_cases

    store, _ = compared
    again = made_comparison.run(tmp_path / "again", store)
    assert again.ok and not again.ran
    cases, data, model, other = made_comparison.inputs(tmp_path / "other")
    g = Graph()
    settings = Settings.of(score_cases=score_cases.Params(levels=(0.4, 0.6)), benchmark=benchmark.Params(resamples=50))
    g.target("benchmark", benchmark_report(g, g.leaf("cases", cases), g.leaf("data", data), g.leaf("model", model),
                                  Origin("tiny", predictions=(other,)), settings))  # fmt: skip
    changed = Runner(store, ROOT, "afford.codecs:CODEC", "afford.common.worker:prepare", jobs=0).run(g, "benchmark")
    assert changed.ok and all(name.startswith("score_") or name == "benchmark" for name in changed.ran)


def made_scores(name: str, iou: list[float], groups: list[tuple[str, ...]]) -> MethodScores:
    n = len(iou)
    values = np.full((n, len(MEASURES)), np.nan)
    values[:, MEASURES.index("iou")] = iou
    ids = tuple(f"cropped/v/{k}" for k in range(n))
    classes = np.array([0, 1, 2], np.int8), np.array([0, 0, -1], np.int8)
    return MethodScores(name, ids, ("cropped",) * n, tuple(groups), ((),) * n, MEASURES, values, (0.5,),
                        np.full((n, 1, 4), np.nan), *classes, np.zeros((n, 3, 15)), ())


def test_groups_are_means_of_their_own_cases() -> None:
    """Kitchens have no prefix; a measure that applies to no case has no number."""
    scores = made_scores("m", [0.2, 0.4, 0.9], [("all", "kitchen"), ("all", "kitchen"), ("all", "shift")])
    metrics = tables.metrics(tables.rows((scores,), 10, 0))
    assert (metrics["m.iou"], metrics["shift.m.iou"], metrics["all.m.iou"]) == pytest.approx((0.3, 0.9, 0.5))
    assert "m.precision" not in metrics and not any(name.startswith("compat") for name in metrics)


def test_confusion_counts_true_by_row() -> None:
    """One left predicted left, one right predicted left; a case without a predicted class does not count."""
    scores = made_scores("m", [0, 0, 0], [("all", "kitchen")] * 3)
    counts = tables.confusion(scores, np.ones(3, bool))
    assert counts is not None and counts[0, 0] == counts[1, 0] == 1 and counts.sum() == 2
    assert "| **right** | 1 | 0 | 0 | 0 |" in tables.confusion_table("m", counts)
