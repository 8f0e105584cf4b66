"""Many worlds at once are the same worlds one after another."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from afford.grasping.sim.engine import BACKENDS, State, make_world
from afford.grasping.sim.scene import randomize_physics
from afford.grasping.sim.worlds import ThreadWorlds
from tests.helpers.made_scenes import at, away, block, commands, scene, tool

CONTROL_S = 0.05


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("engine", sorted(BACKENDS))
def test_worlds_together_are_worlds_apart(engine: str, threads: int) -> None:
    """Other objects and physics in each; on one thread and on two: the same bits as alone."""
    scenes = [randomize_physics(scene(body), seed) for seed, body in enumerate((block(), tool(), block()))]
    together = ThreadWorlds(engine, scenes, threads)
    q, body = np.tile(away(), (3, 1)), np.stack([at(z=0.05 * k) for k in range(3)])
    together.reset(q, body)
    u = np.tile(commands(away()), (3, 1)) + np.arange(3)[:, None] * 0.1
    for _ in range(4):
        found = together.step(u, CONTROL_S)
    for k, one in enumerate(scenes):
        alone = make_world(engine, one)
        alone.reset(q[k], body[k])
        for _ in range(4):
            state = alone.step(u[k], CONTROL_S)
        alone.close()
        for name in (f.name for f in fields(State) if f.name != "force"):
            assert np.array_equal(getattr(found, name)[k], getattr(state, name)), name
        assert np.array_equal(found.force[k, :, : len(one.body.parts)], state.force)
    together.close()
    together.close()


def test_some_worlds_can_begin_again() -> None:
    """Reset of one leaves the others where they are."""
    together = ThreadWorlds("mujoco", [scene()] * 3)
    together.reset(np.tile(away(), (3, 1)), np.tile(at(z=0.3), (3, 1)))
    before = together.step(np.tile(commands(away()), (3, 1)), CONTROL_S)
    assert together.reset(away()[None], at(z=1.0)[None], which=[1]).body[0, 2] == 1.0
    after = together.state()
    assert np.array_equal(after.body[[0, 2]], before.body[[0, 2]])
    assert after.body[1, 2] == 1.0
    together.close()


def test_no_worlds_are_refused() -> None:
    """And so are no threads."""
    with pytest.raises(ValueError, match="one scene or more"):
        ThreadWorlds("mujoco", [])
    with pytest.raises(ValueError, match="one thread or more"):
        ThreadWorlds("mujoco", [scene()], threads=0)
