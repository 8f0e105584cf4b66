"""Reward terms: published sets by hand, and the dense set."""

from __future__ import annotations

import numpy as np
import pytest

from afford.grasping.env.reward import REWARDS, TERMS, reward_weights, rewards, scaled_negative_weights
from tests.helpers.made_grasps import measured


def total(name: str, **given: object) -> float:
    return float(sum(term[0] for term in rewards(reward_weights(name), measured(**given)).values()))


def test_paper_reward_by_hand() -> None:
    """Hand 10 cm from the object, 4 cm to the goal, two fingertips 2 cm from negative points: -19.14 (AffordDex's teacher)."""
    near = [[0.02, 0.02, 0.5, 0.031, 0.5]]
    assert total("afforddex", palm_m=[0.1], goal_m=[0.04], N_m=near) == pytest.approx(-19.14)


def test_bounds_are_strict() -> None:
    """Exactly 5 cm are no success, exactly 3 cm no violation; without negative points there is no violation."""
    assert total("afforddex", palm_m=[0.0], goal_m=[0.05]) == pytest.approx(-0.05)
    assert total("afforddex", palm_m=[0.0], goal_m=[0.06], N_m=[[0.03] * 5]) == pytest.approx(-0.06)
    assert total("afforddex", palm_m=[0.0], goal_m=[0.06], N_m=[[np.inf] * 5]) == pytest.approx(-0.06)


def test_unidexgrasp_reward_by_hand() -> None:
    """Far away only capped distances count; near the object, carrying, raising and arriving are rewarded (AffordDex's code)."""
    assert total("unidexgrasp++", tips_centre_m=[[1.0] * 5], palm_m=[2.0]) == pytest.approx(-0.5 * 3 - 0.5)
    at = {"tips_centre_m": [[0.1] * 5], "palm_m": [0.1]}
    up = np.zeros((1, 24))
    up[0, 2] = 0.5
    assert total("unidexgrasp++", **at, goal_m=[0.2]) == pytest.approx(-0.25 - 0.1 + 0.5)
    assert total("unidexgrasp++", **at, goal_m=[0.2], height_m=[0.03], action=up) == pytest.approx(-0.35 + 0.5 + 0.15)
    assert total("unidexgrasp++", **at, goal_m=[0.05], height_m=[0.2]) == pytest.approx(-0.35 + 0.8 + 0.2 + 1 / 1.5)


def test_dense_reward_needs_a_grip() -> None:
    """Reward at the goal without a grip equals that at the start; a grip adds to it, a negative contact reduces it."""
    grip, bare = [[1.0, 0.0, 2.0, 0.0, 0.0, 0.0]], [[0.0] * 6]
    at = {"tips_m": [[0.0] * 5], "allowed_m": [[0.0] * 5], "goal_m": [0.01]}
    assert total("dense", **at, force_held=bare) == 0.0
    assert total("dense", **at, force_held=grip) == pytest.approx(2 * 0.14 + 1)
    assert total("dense", **at, force_held=grip, force_told=[[0, 1, 1, 0, 0, 0]]) == pytest.approx(1.28 - 0.25)
    assert total("dense", **at, force_held=grip, N_m=[[0.01, 1, 1, 1, 1]]) == pytest.approx(1.28 - 0.7 * 0.75 / 5)
    detour = {**at, "allowed_m": [[0.06, 0.04, 0.0, 0.0, 0.0]]}
    assert total("dense", **detour, force_held=grip) == pytest.approx(1.28 - 4 * 0.02)


def test_positive_term_attracts_when_weighted() -> None:
    """A weight of -2 costs twice the mean distance of the fingertips to A_t; the default costs nothing."""
    given = measured(positive_m=[[0.1, 0.1, 0.0, 0.0, 0.0]])
    assert rewards(reward_weights("dense"), given)["positive"] == 0
    assert rewards(reward_weights("dense", {"positive": -2.0}), given)["positive"] == pytest.approx(-0.08)


def test_negative_terms_can_be_switched_off() -> None:
    """A scale of 0 removes exactly the negative terms."""
    off = reward_weights("dense", scaled_negative_weights("dense", 0.0))
    given = measured(goal_m=[0.01], N_m=[[0.0] * 5], force_told=[[1.0] * 6], allowed_m=[[2.0] * 5])
    full, without = rewards(reward_weights("dense"), given), rewards(off, given)
    assert {name for name in full if full[name] != without[name]} == {name for name in full if name.startswith("negative")}
    assert not any(without[name] for name in without if name.startswith("negative"))
    assert reward_weights("afforddex", scaled_negative_weights("afforddex", 0.5))["negative_tips"] == -5.0


def test_negative_terms_can_be_added_to_other_sets() -> None:
    """NAA extends UniDexGrasp++ by configuration alone; without it the set is unchanged."""
    plugged, off = (reward_weights("unidexgrasp++", scaled_negative_weights("unidexgrasp++", scale)) for scale in (1.0, 0.0))
    mine = {name: weight for name, weight in REWARDS["dense"].items() if name.startswith("negative")}
    assert plugged == {**REWARDS["unidexgrasp++"], **mine} and not any(off[name] for name in mine)


def test_grip_needs_two_contacts() -> None:
    """One finger, or a contact below the threshold, is no grip; two fingers, or one and the palm, are."""
    assert not measured(force_held=[[0, 1, 0, 0, 0, 0]], force_negative=[[0, 1, 0, 0, 0, 0]]).gripped[0]
    assert not measured(force_held=[[1, 0.005, 0, 0, 0, 0]]).gripped[0]
    assert measured(force_held=[[0, 0, 0, 0, 1, 1]]).gripped[0]


def test_weights_of_a_set_can_be_changed() -> None:
    """Another weight for one term leaves the others; unknown names are refused."""
    assert {name for table in REWARDS.values() for name in table} == set(TERMS)
    assert reward_weights("afforddex", {"negative_tips": -5.0}) == {**REWARDS["afforddex"], "negative_tips": -5.0}
    with pytest.raises(ValueError, match="got 'best'"):
        reward_weights("best")
    with pytest.raises(ValueError, match="got luck"):
        reward_weights("dense", {"luck": 1.0})
