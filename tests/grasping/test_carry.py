"""Carry of a raised object to its goal by the wrist."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from afford.grasping.env.actions import turned
from afford.grasping.env.carry import FASTER, GAIN, carried
from afford.grasping.env.config import GraspEnvConfig
from afford.grasping.env.placed_worlds import PlacedWorlds
from tests.grasping.test_bodies import stick, tasks_of
from tests.helpers.made_hands import shadow

TWO = tuple(tasks_of(stick()).tasks[1:]) * 2


@pytest.fixture
def worlds(monkeypatch: pytest.MonkeyPatch) -> Iterator[PlacedWorlds]:
    """Two worlds with a stick, which is gripped and 5 cm above the table in the second."""
    made = PlacedWorlds(shadow(), TWO, GraspEnvConfig(steps=4))
    made.reset([0, 1], [np.random.default_rng(k) for k in range(2)])
    now = made.snapshot()
    body, force = now.state.body.copy(), now.measures.force_held.copy()
    body[1, 2], force[1, :2] = body[1, 2] + 0.05, 1.0
    raised = replace(now, state=replace(now.state, body=body), measures=replace(now.measures, force_held=force))
    monkeypatch.setattr(made, "snapshot", lambda: raised)
    yield made
    made.close()


def test_the_wrist_moves_towards_the_goal_of_a_raised_object(worlds: PlacedWorlds) -> None:
    """Its slides move by a share of the distance, in the frame of the episode; other motors and other worlds act as before."""
    worlds.episode.goal[1] = worlds.scenery.centre(worlds.snapshot().state)[1] + (0.006, -0.01, 0.004)
    action = np.random.default_rng(1).uniform(-1, 1, (2, worlds.motors))
    found = carried(worlds, action)
    moved = turned(found * worlds.rates[:, 0], worlds.episode.yaw)[1, :3]
    np.testing.assert_allclose(moved, GAIN * np.array([0.006, -0.01, 0.004]), atol=1e-9)
    assert (found[0] == action[0]).all() and (found[1, 3:] == action[1, 3:]).all()


def test_a_carry_begins_without_a_jerk(worlds: PlacedWorlds) -> None:
    """The goal is far, but the first action is a quarter of a full one."""
    found = carried(worlds, np.zeros((2, worlds.motors)))
    assert np.abs(found[1, :3]).max() == pytest.approx(FASTER) and not found[0].any()
