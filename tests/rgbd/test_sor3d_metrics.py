"""Measures of SOR3D-AFF, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from afford.rgbd.evaluate import metrics as sor3d
from schemas.interaction import AFFORDANCES, BACKGROUND

GRASP, CUT, PUSH = (AFFORDANCES.index(name) for name in ("grasp", "cut", "push"))
B = BACKGROUND
TRUTH = np.array([[[GRASP, GRASP, GRASP, B]], [[CUT, CUT, B, B]]])
FOUND = np.array([[[GRASP, GRASP, B, GRASP]], [[GRASP, CUT, B, B]]])


def test_iou_and_f_by_hand() -> None:
    """grasp: 2 hits, 4 found, 3 true; cut: 1, 1, 2; other categories have no score."""
    of = sor3d.counts(FOUND, TRUTH)
    assert sor3d.iou(of)[[GRASP, CUT]].tolist() == [2 / 5, 1 / 2]
    assert sor3d.f_beta(of)[[GRASP, CUT]].tolist() == pytest.approx([4 / 7, 2 / 3])
    assert np.isnan(sor3d.iou(of)[PUSH])
    said = sor3d.summary(of)
    assert said["iou"] == pytest.approx(0.45) and said["f"] == pytest.approx((4 / 7 + 2 / 3) / 2)
    assert said["fw"] == pytest.approx((0.2 * 4 / 7 + 0.083 * 2 / 3) / 0.283)
    assert set(said) == {"iou", "f", "fw", "iou.grasp", "iou.cut", "f.grasp", "f.cut"}


def test_beta_prefers_recall() -> None:
    """b = 2 of precision 1 and recall 1/2: 5/2 / (4 + 1/2); b = 0 is precision."""
    of = sor3d.counts(np.array([[CUT, B]]), np.array([[CUT, CUT]]))
    assert sor3d.f_beta(of, 2.0)[CUT] == pytest.approx(5 * 0.5 / (4 * 1 + 0.5))
    assert sor3d.f_beta(of, 0.0)[CUT] == 1.0


def test_the_papers_weights() -> None:
    """The weights sum to 0.998; equal scores have themselves as their mean."""
    weights = [sor3d.WEIGHTS.get(name, sor3d.OTHER_WEIGHT) for name in AFFORDANCES]
    assert sum(weights) == pytest.approx(0.998)
    assert sor3d.weighted(np.full(9, 0.7)) == pytest.approx(0.7)
    assert sor3d.weighted(np.eye(9)[GRASP]) == pytest.approx(0.2 / 0.998)


def test_counts_add_up() -> None:
    """A set is the sum of its sequences."""
    whole = sor3d.counts(FOUND, TRUTH)
    parts = sor3d.counts(FOUND[:1], TRUTH[:1]) + sor3d.counts(FOUND[1:], TRUTH[1:])
    assert all(np.array_equal(getattr(whole, name), getattr(parts, name)) for name in ("hit", "found", "true"))


def test_background_alone_has_no_score() -> None:
    """NaN, not 0 and not 1."""
    said = sor3d.summary(sor3d.counts(np.full((1, 2, 2), B), np.full((1, 2, 2), B)))
    assert all(np.isnan(said[name]) for name in ("iou", "f", "fw")) and len(said) == 3


def test_metrics_of_the_released_code() -> None:
    """Accuracy under the name of Jaccard; one minus F1 under the name of F1."""
    assert sor3d.code_jaccard(FOUND, TRUTH) == pytest.approx(5 / 8)
    confidence = np.zeros((10, 1, 4))
    confidence[GRASP, 0] = (0.9, 0.75, 0.8, 0.1)
    assert sor3d.code_f1(confidence, TRUTH[:1][0]) == pytest.approx(1 - 2 * 2 / (2 + 3))
    confidence[B] = 1.0
    assert sor3d.code_f1(confidence, TRUTH[:1][0]) == pytest.approx(1 - 4 / 5)
