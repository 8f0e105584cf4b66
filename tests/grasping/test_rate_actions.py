"""Rate actions: rates, caps, limits, frames."""

from __future__ import annotations

import numpy as np
import pytest

from afford.grasping.env.actions import RATES, moved, rate_command, rate_table, towards, turned

LIMITS = np.tile([-1.0, 1.0], (24, 1))


@pytest.mark.parametrize("base", sorted(RATES))
def test_full_action_moves_by_the_rate_up_to_the_cap(base: str) -> None:
    """Actions beyond 1 count as 1."""
    rates = rate_table(RATES[base], 24)
    offset = np.zeros((1, 24))
    assert moved(rates, offset, np.full((1, 24), 7.0))[0] == pytest.approx(rates[:, 0])
    for _ in range(200):
        offset = moved(rates, offset, -np.ones((1, 24)))
    assert offset[0] == pytest.approx(-np.minimum(rates[:, 1], 200 * rates[:, 0]))


def test_offsets_do_not_wind_up_beyond_a_limit() -> None:
    """One step back moves the target back after a hundred steps against a limit."""
    rates, base, yaw = rate_table(RATES["none"], 24), np.zeros((1, 24)), np.array([0.7])
    offset = np.zeros((1, 24))
    for _ in range(100):
        u, offset = rate_command(base, moved(rates, offset, np.ones((1, 24))), yaw, LIMITS)
    assert (u <= 1.0).all()
    back, _ = rate_command(base, moved(rates, offset, -np.ones((1, 24))), yaw, LIMITS)
    assert (back[0, 2:] < 1.0).all()


def test_x_is_along_the_frame_of_the_episode() -> None:
    """Action x moves the wrist along y of the world at a yaw of a quarter turn."""
    rates, action = rate_table(RATES["none"], 24), np.zeros((1, 24))
    action[0, 0] = 1.0
    u, _ = rate_command(np.zeros((1, 24)), moved(rates, np.zeros((1, 24)), action), np.array([np.pi / 2]), LIMITS)
    assert u[0, :3] == pytest.approx([0, 0.03, 0])


def test_towards_reaches_near_targets_in_one_step() -> None:
    """A far target is approached by a full step."""
    rng, rates, yaw = np.random.default_rng(0), rate_table(RATES["none"], 24), np.array([0.4])
    before = rng.uniform(-0.2, 0.2, (1, 24))
    near = before + turned(rng.uniform(-1, 1, (1, 24)) * rates[:, 0], yaw)
    action = towards(rates, before, near, yaw)
    assert before + turned(moved(rates, np.zeros((1, 24)), action), yaw) == pytest.approx(near)
    assert np.abs(towards(rates, before, near + 5.0, yaw)).max() == 1.0
