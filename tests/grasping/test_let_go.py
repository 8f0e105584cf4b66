"""Release of fingers near N_t of a raised object."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from afford.grasping.env.config import GraspEnvConfig
from afford.grasping.env.let_go import CLEAR_M, HOLDERS, flexing_motors, released, spare_fingers
from afford.grasping.env.measures import Measures
from afford.grasping.env.placed_worlds import PlacedWorlds
from afford.grasping.hand.kinematics import commanded_joints
from tests.grasping.test_bodies import stick, tasks_of
from tests.helpers.made_hands import shadow

NEAR, FAR = CLEAR_M / 2, 1.0


def touched(measured: Measures, fingers: tuple[int, ...], N_m: tuple[float, ...]) -> Measures:
    """Measurements in which some fingers touch, at distances to N_t."""
    force = np.zeros_like(measured.force_held)
    force[:, fingers] = 1.0
    return replace(measured, force_held=force, force_negative=0 * force, N_m=np.tile(N_m, (len(force), 1)))


@pytest.fixture(scope="module")
def worlds() -> PlacedWorlds:
    made = PlacedWorlds(shadow(), tuple(tasks_of(stick()).tasks[1:]) * 2, GraspEnvConfig(steps=4))
    made.reset([0, 1], [np.random.default_rng(k) for k in range(2)])
    return made


@pytest.mark.parametrize(("fingers", "N_m", "spare"), [
    ((0, 1, 2, 3, 4), (NEAR, NEAR, NEAR, FAR, FAR), [1, 2]), ((0, 1, 2, 3, 4), (NEAR,) * 5, [3, 4]),
    ((0, 1, 2), (FAR, NEAR, NEAR, FAR, FAR), []), ((0, 1), (FAR, FAR, NEAR, FAR, FAR), []),
    ((0, 1, 2), (FAR, FAR, FAR, FAR, NEAR), [4]), ((0, 1, 2, 3, 4), (FAR,) * 5, []),
], ids=["two near", "all near", "needed", "one beside the thumb", "near without a touch", "far"])  # fmt: skip
def test_spare_fingers(worlds: PlacedWorlds, fingers: tuple[int, ...], N_m: tuple[float, ...], spare: list[int]) -> None:
    """The thumb and the two touching fingers that are farthest from N_t are never spare."""
    found = spare_fingers(touched(worlds.measures(), fingers, N_m))
    assert np.flatnonzero(found[0]).tolist() == spare and HOLDERS == 2


def test_spare_fingers_straighten_on_raised_objects(worlds: PlacedWorlds, monkeypatch: pytest.MonkeyPatch) -> None:
    """The second object is raised: the index straightens, all else acts as before."""
    now = worlds.snapshot()
    body = now.state.body.copy()
    body[1, 2] += 0.05
    measured = touched(now.measures, (0, 1, 2, 3, 4), (FAR, NEAR, FAR, FAR, FAR))
    monkeypatch.setattr(worlds, "snapshot", lambda: replace(now, state=replace(now.state, body=body), measures=measured))
    action = np.random.default_rng(1).uniform(-0.9, 0.9, (2, worlds.motors))
    found, index = released(worlds, action), flexing_motors(shadow())[1]
    assert (found[1, index] == -1).all() and (np.delete(found[1], index) == np.delete(action[1], index)).all()
    assert (found[0] == action[0]).all()


def test_flexing_motors_of_the_shadow_hand() -> None:
    """Fingers straighten by their own base and middle joints, not by spreading."""
    names = [shadow().joints.name[k] for k in commanded_joints(shadow().joints)]
    assert [[names[k] for k in motors] for motors in flexing_motors(shadow())[1:4]] == [
        ["FFJ2", "FFJ1"], ["MFJ2", "MFJ1"], ["RFJ2", "RFJ1"]]  # fmt: skip
