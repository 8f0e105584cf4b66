"""Human likeness: human motions score high, tremor and detours lower."""

from __future__ import annotations

import numpy as np
import pytest

from afford.grasping.evaluate.human_likeness import criteria, human_likeness, human_statistics, log_jerk
from tests.helpers.made_grasps import reference
from tests.helpers.made_hands import shadow

RATE = 20.0


def humans() -> list:  # type: ignore[type-arg]  # references
    return [reference(shadow(), 90, seed) for seed in range(6)]


def path(one) -> tuple[np.ndarray, np.ndarray]:  # type: ignore[no-untyped-def]  # a reference
    return one.q[::3, 6:], one.T_world_palm[::3, :3, 3]


def test_human_motions_score_high() -> None:
    known = human_statistics(humans(), RATE)
    scores = [human_likeness(*path(one), RATE, known)[0] for one in humans()]
    assert min(scores) > 6 and float(np.mean(scores)) > 8.5


def test_tremor_lowers_the_score() -> None:
    known, (q, palm) = human_statistics(humans(), RATE), path(humans()[0])
    noise = np.random.default_rng(0).normal(size=q.shape)
    scores = [human_likeness(q + size * noise, palm, RATE, known)[0] for size in (0.0, 0.03, 0.3)]
    assert scores[0] > scores[1] > scores[2]


def test_a_detour_lowers_the_score() -> None:
    known, (q, palm) = human_statistics(humans(), RATE), path(humans()[0])
    t = np.linspace(0, 2 * np.pi, len(palm))[:, None]
    wide = palm + 0.3 * np.concatenate([np.sin(2 * t), np.cos(2 * t), 0 * t], axis=1)
    assert human_likeness(q, wide, RATE, known)[1][0] < human_likeness(q, palm, RATE, known)[1][0]


def test_log_jerk_of_a_minimum_jerk_reach() -> None:
    """ln(720 / 1.875^2) by the integral of the polynomial, independent of scale and rate."""
    s = np.linspace(0, 1, 2001)[:, None]
    x = 10 * s**3 - 15 * s**4 + 6 * s**5
    wanted = np.log(720 / 1.875**2)
    assert log_jerk(x, 2000.0) == pytest.approx(wanted, abs=0.02)
    assert log_jerk(7 * x, 2000.0) == pytest.approx(log_jerk(x, 2000.0)) == pytest.approx(log_jerk(x, 500.0))
    assert log_jerk(np.ones((9, 3)), 20.0) == 0.0


def test_synergies_explain_their_own_motion() -> None:
    known = human_statistics(humans(), RATE)
    t = np.linspace(0, 1, 40)[:, None]
    within = known.posture + t * known.synergies[:1]
    palm = np.concatenate([0 * t, 0 * t, np.abs(t - 0.5)], axis=1)
    assert criteria(within, palm, RATE, known.posture, known.synergies)[2] == pytest.approx(0, abs=1e-9)


def test_one_reference_is_rejected() -> None:
    with pytest.raises(ValueError, match="two references or more"):
        human_statistics(humans()[:1], RATE)
