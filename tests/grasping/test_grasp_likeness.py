"""Likeness to people: their own motions are usual, trembling and detours are not."""

from __future__ import annotations

import numpy as np
import pytest

from afford.grasping.evaluate.human_likeness import criteria, human_likeness, human_statistics, log_jerk
from tests.helpers.made_grasps import reference
from tests.helpers.made_hands import shadow

RATE = 20.0


def people() -> list:  # type: ignore[type-arg]  # references
    return [reference(shadow(), 90, seed) for seed in range(6)]


def path(one) -> tuple[np.ndarray, np.ndarray]:  # type: ignore[no-untyped-def]  # a reference
    return one.q[::3, 6:], one.T_world_palm[::3, :3, 3]


def test_people_are_human() -> None:
    known = human_statistics(people(), RATE)
    scores = [human_likeness(*path(one), RATE, known)[0] for one in people()]
    assert min(scores) > 6 and float(np.mean(scores)) > 8.5


def test_trembling_is_less_human_and_more_of_it_less_so() -> None:
    known, (q, palm) = human_statistics(people(), RATE), path(people()[0])
    noise = np.random.default_rng(0).normal(size=q.shape)
    scores = [human_likeness(q + size * noise, palm, RATE, known)[0] for size in (0.0, 0.03, 0.3)]
    assert scores[0] > scores[1] > scores[2]


def test_a_detour_costs_by_its_length() -> None:
    known, (q, palm) = human_statistics(people(), RATE), path(people()[0])
    t = np.linspace(0, 2 * np.pi, len(palm))[:, None]
    wide = palm + 0.3 * np.concatenate([np.sin(2 * t), np.cos(2 * t), 0 * t], axis=1)
    assert human_likeness(q, wide, RATE, known)[1][0] < human_likeness(q, palm, RATE, known)[1][0]


def test_jerk_of_a_minimum_jerk_reach_is_known_and_has_no_unit() -> None:
    """360 of T^5/D^2 units over the peak speed 1.875 D/T squared: ln(720 * ... ) by the integral of the polynomial."""
    s = np.linspace(0, 1, 2001)[:, None]
    x = 10 * s**3 - 15 * s**4 + 6 * s**5
    wanted = np.log(720 / 1.875**2)
    assert log_jerk(x, 2000.0) == pytest.approx(wanted, abs=0.02)
    assert log_jerk(7 * x, 2000.0) == pytest.approx(log_jerk(x, 2000.0)) == pytest.approx(log_jerk(x, 500.0))
    assert log_jerk(np.ones((9, 3)), 20.0) == 0.0


def test_motion_within_the_synergies_is_explained() -> None:
    known = human_statistics(people(), RATE)
    t = np.linspace(0, 1, 40)[:, None]
    within = known.posture + t * known.synergies[:1]
    palm = np.concatenate([0 * t, 0 * t, np.abs(t - 0.5)], axis=1)
    assert criteria(within, palm, RATE, known.posture, known.synergies)[2] == pytest.approx(0, abs=1e-9)


def test_one_person_is_not_people() -> None:
    with pytest.raises(ValueError, match="two references or more"):
        human_statistics(people()[:1], RATE)
