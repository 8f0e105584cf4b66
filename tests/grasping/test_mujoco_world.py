"""Retries and limits of MuJoCo worlds; test_engines.py tests the common contract."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from afford.grasping.sim.mujoco_world import MujocoWorld
from tests.helpers.made_scenes import away, commands, scene


def falling_poses(jacobian: int, iterations: int) -> np.ndarray:
    """Return (20, 7) poses of a block that falls at an angle onto the table, for a limit of solver iterations."""
    made = MujocoWorld(scene(iterations=iterations))
    made.model.opt.jacobian = jacobian
    made.reset(away(), np.array([0.0, 0.0, 0.12, 0.2, 0.1, 0.0, np.sqrt(0.95)]))
    return np.stack([made.step(commands(away()), 0.05).body for _ in range(20)])


def test_unconverged_steps_are_retried_with_a_dense_jacobian() -> None:
    """No step converges within one iteration, so all equal those of a dense world to the bit."""
    sparse, dense = mujoco.mjtJacobian.mjJAC_SPARSE, mujoco.mjtJacobian.mjJAC_DENSE
    assert np.array_equal(falling_poses(sparse, 1), falling_poses(dense, 1))
    assert np.allclose(falling_poses(sparse, 100), falling_poses(dense, 100), atol=1e-3)
    assert not np.array_equal(falling_poses(sparse, 100), falling_poses(dense, 100))


class Refusing(MujocoWorld):
    """World whose next `refused` steps fail."""

    refused = 0

    def _moved(self) -> bool:
        done = super()._moved()
        self.refused -= 1
        return done and self.refused < 0


@pytest.mark.parametrize("refused", [1, 2])
def test_diverging_steps_are_retried_in_smaller_steps(refused: int) -> None:
    """A falling block ends where it would without failures, and the time step is restored."""
    plain, other = MujocoWorld(scene()), Refusing(scene())
    ends = []
    for world in (plain, other):
        world.reset(away(), np.array([0.0, 0.0, 0.3, 0.0, 0.0, 0.0, 1.0]))
        other.refused = refused
        ends.append(np.stack([world.step(commands(away()), 0.05).body for _ in range(3)]))
    assert other.refused < 0
    assert np.allclose(*ends, atol=1e-4)
    assert other.model.opt.timestep == plain.model.opt.timestep


def test_a_diverged_world_raises_and_can_be_reset() -> None:
    block = np.array([0.0, 0.0, 0.3, 0.0, 0.0, 0.0, 1.0])
    world, fresh = MujocoWorld(scene()), MujocoWorld(scene())
    world.reset(away(), block)
    world.push(np.array([1e13, 0.0, 0.0]), 0.05)
    with pytest.raises(RuntimeError, match=r"diverged.*a rate above"):
        world.step(commands(away()), 0.05)
    ends = []
    for one in (world, fresh):
        one.reset(away(), block)
        ends.append(one.step(commands(away()), 0.05).body)
    assert np.array_equal(*ends)


def test_velocities_are_clamped() -> None:
    """Forces drive the block to the limit and to half of it."""
    world = MujocoWorld(scene())
    reached = []
    for newtons in (1.0, 0.5, 100.0):
        world.reset(away(), np.array([0.0, 0.0, 0.3, 0.0, 0.0, 0.0, 1.0]))
        world.push(np.array([newtons * world.scene.body.mass_kg * 100.0 / 0.05, 0.0, 0.0]), 0.05)
        reached.append(float(world.step(commands(away()), 0.05).velocity[0]))
    assert np.allclose(reached, [100.0, 50.0, 100.0], atol=1.5)
