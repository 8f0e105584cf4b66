"""Scores by hand computation, properties of baselines, and means of the report."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from afford.surface.negative import baselines, score_report
from afford.surface.negative.score import METHODS
from schemas.surface import NegativeScore, NegativeScores
from stages.surface import negative_affordance_report, negative_affordance_score
from tests.helpers.made_objects import Looked, looked, projected, true_scores
from tests.helpers.made_samples import Scratch

NAN = float("nan")


def scored(x: Looked, **changed: np.ndarray) -> NegativeScores:
    found = projected(x)
    if changed:
        found = replace(found, tasks=tuple(replace(one, **changed) for one in found.tasks))
    windows = x.windows()
    return negative_affordance_score.run(x.mesh, x.parts, x.views, x.candidates, x.told, true_scores(x), windows,
                                         true_scores(x, windows), found, negative_affordance_score.Params(), x.spec)  # fmt: skip


def rows(found: NegativeScores, method: str) -> list[NegativeScore]:
    return [row for row in found.rows if row.method == method]


def test_perfect_and_empty_surfaces() -> None:
    """Check scores by visible area; hidden faces do not count."""
    x = looked()
    for row in rows(scored(x), "afford"):
        assert min(row.iou, row.precision, row.recall, row.point_recall) > 0.9
    nothing = rows(scored(x, probability=np.zeros(len(x.mesh.faces), np.float32)), "afford")
    assert all(row.iou == row.precision == row.recall == row.point_recall == row.said == 0 for row in nothing)


def test_whole_object_has_recall_one() -> None:
    """Check that the precisions of complementary tasks add up to 1."""
    use, give = rows(scored(looked()), "whole_object")
    assert use.recall == give.recall == use.said == 1 and use.iou == pytest.approx(use.precision)
    assert use.precision + give.precision == pytest.approx(1, abs=1e-6)


def test_tasks_without_a_negative_part_have_no_score() -> None:
    """Check NaN, with the predicted share kept (a cold pan may be held anywhere)."""
    x = looked("pan")
    cold = [row for row in scored(x).rows if row.task == "carry the cold pan"]
    assert len(cold) == len(METHODS) and all(np.isnan(row.iou) and np.isnan(row.point_recall) for row in cold)
    assert {row.said for row in cold if row.method not in ("whole_object", "random_candidate")} == {0.0}


def test_paper_recipe_always_selects_a_mask() -> None:
    """Check true overlaps, and views without the part."""
    x = looked()
    use = x.told.descriptions[0]
    found = baselines.splat_masks(x.mesh, x.views, baselines.paper_recipe(x.candidates, use, true_scores(x)))
    shaft = x.parts.part == x.parts.names.index("shaft")
    assert found[shaft].mean() > 0.5 and found.any()
    silent = replace(true_scores(x), overlap=np.zeros_like(true_scores(x).overlap))
    assert baselines.splat_masks(x.mesh, x.views, baselines.paper_recipe(x.candidates, use, silent)).any()
    assert not baselines.splat_masks(x.mesh, x.views, baselines.paper_recipe(x.candidates, replace(use, notes=()), silent)).any()


def test_random_candidate_depends_on_the_seed() -> None:
    """Check equal faces for equal seeds."""
    x = looked()
    taken = (baselines.random_candidate(x.candidates, np.random.default_rng(seed)) for seed in (1, 1, 2, 3, 4))
    a, b, *others = (baselines.splat_masks(x.mesh, x.views, masks) for masks in taken)
    assert np.array_equal(a, b) and any(not np.array_equal(a, other) for other in others)


def test_whole_object_measure_of_mask_methods() -> None:
    """Check a share of views for mask methods, NaN for others."""
    found = scored(looked())
    for method in METHODS:
        shares = [row.whole_object_taken for row in rows(found, method)]
        takes = method in ("paper_recipe", "coarse_box", "random_candidate")
        assert all(0 <= share <= 1 if takes else np.isnan(share) for share in shares), method


def made(name: str, split: str, look: str, *ious: float, method: str = "afford", taken: float = NAN) -> NegativeScores:
    each = tuple(NegativeScore(method, f"task {n}", iou, iou, iou, iou, 0.5, taken) for n, iou in enumerate(ious))
    picture = cv2.imencode(".jpg", np.full((16, 32, 3), 90, np.uint8))[1].reshape(-1)
    return NegativeScores(name, name.partition("_")[0], split, look, 0.8, 0.99, each, picture)


def test_means_over_objects_of_means_over_tasks() -> None:
    """Check an object with many tasks, and tasks without a negative part."""
    found = score_report.metrics([made("mug_1", "unseen", "plain", 0.2, 0.4, NAN), made("axe_1", "unseen", "mixed", 0.9)])
    assert found["unseen.iou"] == pytest.approx((0.3 + 0.9) / 2) and found["unseen.plain.iou"] == pytest.approx(0.3)
    assert found["seen_area.six"] == pytest.approx(0.8) and found["seen_area.adaptive"] == pytest.approx(0.99)
    assert "seen.iou" not in found and not any(np.isnan(value) for value in found.values())


def test_rows_of_tasks() -> None:
    """Check means over objects of a category, and tasks without IoU."""
    mugs = [made("mug_1", "seen", "plain", 0.2, 0.9, NAN), made("mug_2", "seen", "mixed", 0.4, 0.7, NAN)]
    found = score_report.metrics(mugs)
    assert (found["pairs"], found["pairs_found"]) == (2, 1)
    text = score_report.markdown(mugs, found)
    assert "| mug: task 0 | seen | 0.300 |" in text and "| mug: task 1 | seen | 0.800 |" in text
    assert "| mug: task 2 | seen |  |  |  | 0.500 |" in text and "1 of 2 pairs" in text


def test_whole_object_measure_is_averaged_over_objects() -> None:
    """Check means by split and in total, without truth, and without masks."""
    boxed = [made("mug_1", "unseen", "plain", 0.2, NAN, method="coarse_box", taken=0.5),
             made("axe_1", "given", "given", NAN, method="coarse_box", taken=1.0),
             made("pan_1", "given", "given", NAN, method="coarse_box")]  # fmt: skip
    found = score_report.metrics(boxed)
    assert found["coarse_box.whole_object_taken"] == 0.75 and found["coarse_box.given.whole_object_taken"] == 1
    assert found["coarse_box.unseen.iou"] == pytest.approx(0.2) and "afford.whole_object_taken" not in found
    assert "| coarse box | unseen | 0.200 | 0.200 | 0.200 | 0.200 | 0.500 |" in score_report.markdown(boxed, found)


def test_report_files(tmp_path) -> None:  # type: ignore[no-untyped-def]
    """Check metrics, tables, and a sheet with one row for each category and split."""
    scores = (made("mug_1", "seen", "plain", 0.5), made("mug_2", "seen", "mixed", 0.7), made("axe_1", "unseen", "mixed", 0.9))
    found = negative_affordance_report.run(scores, negative_affordance_report.Params(), Scratch(tmp_path))
    assert [file.name for file in found.files] == ["metrics.json", "report.md", "sheet.jpg"]
    sheet = cv2.imread(str(found.files[2].path))
    assert sheet.shape == (32, 32, 3)
    text = found.files[1].path.read_text()
    assert "| mug | seen | 0.600 |" in text and "| afford | unseen | 0.900 |" in text
    with pytest.raises(ValueError, match="no scored object"):
        negative_affordance_report.run((), negative_affordance_report.Params(), Scratch(tmp_path))


def test_sheet_row_is_red_on_negative_faces() -> None:
    """Check seven tiles: red on the shaft, green on the handle."""
    x = looked()
    picture = cv2.imdecode(scored(x).picture, cv2.IMREAD_COLOR)[..., ::-1].astype(int)
    assert picture.shape == (168, 7 * 168, 3)
    red = (picture[..., 0] - picture[..., 1] > 40).reshape(168, 7, 168).any((0, 2))
    green = (picture[..., 1] - picture[..., 0] > 20).reshape(168, 7, 168).any((0, 2))
    assert red[:6].sum() >= 4 and green[:6].sum() >= 4 and not red[6]
