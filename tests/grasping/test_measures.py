"""Metrics of an episode."""

from __future__ import annotations

import numpy as np
import pytest

from afford.grasping.env.measures import METRICS, EpisodeLog, as_safe_count, as_violation_pct
from tests.helpers.made_grasps import measured


def test_affordance_scores_by_hand() -> None:
    """Distances of 1, 3, 5, 2, 2.1 cm: three safe fingertips (strictly beyond 2 cm), 40 percent violations (AffordDex's AS)."""
    N_m = np.array([[0.01, 0.03, 0.05, 0.02, 0.021]])
    assert as_safe_count(N_m)[0] == 3
    assert as_violation_pct(N_m)[0] == pytest.approx(40.0)


def test_fingertips_are_safe_without_negative_points() -> None:
    """Distances are infinite."""
    N_m = np.full((1, 5), np.inf)
    assert as_safe_count(N_m)[0] == 5
    assert as_violation_pct(N_m)[0] == 0.0


def test_success_is_sticky_and_held_is_not() -> None:
    """An object at the goal once, then dropped, is a success, but not held; a contact with a negative part is remembered."""
    log, step = EpisodeLog(1, 3), np.array([0])
    log.record(measured(goal_m=[0.049], force_held=[[1] * 6], penetration_m=[0.004]), step)
    log.record(measured(goal_m=[0.3], force_negative=[[0, 1, 0, 0, 0, 0]], N_true_m=[[0.02, 1, 1, 1, 1]],
                      penetration_m=[0.001]), step + 1)  # fmt: skip
    last = measured(goal_m=[0.2])
    log.record(last, step + 2)
    found = {name: figure[0] for name, figure in log.report(last).items()}
    assert set(found) == set(METRICS)
    assert (found["success"], found["held"]) == (1.0, 0.0)
    assert (found["negative_contact_any"], found["negative_contact_end"]) == (1.0, 0.0)
    assert (found["as_any_step"], found["as_violation_pct"]) == (1.0, 0.0)
    assert found["penetration_median_m"] == pytest.approx(0.0025)
    assert found["penetration_p95_m"] == pytest.approx(0.001 + 0.95 * 0.003)


def test_depth_is_nan_without_contact() -> None:
    """A depth of 0 would look better than it is; a new episode forgets the previous one."""
    log = EpisodeLog(2, 1)
    log.record(measured(goal_m=[0.0, 0.0], force_held=[[1] * 6, [0] * 6], force_negative=[[0] * 6] * 2, N_true_m=[[1] * 5] * 2,
                      penetration_m=[0.001, 0.0]), np.zeros(2, int))  # fmt: skip
    log.clear(np.array([0]))
    assert log.success.tolist() == [False, True]
    assert np.isnan(log.depth_m).all()
