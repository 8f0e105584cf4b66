"""What MuJoCo's world does by itself; the contract is tested in test_engines.py."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from afford.grasping.sim.mujoco_world import MujocoWorld
from tests.helpers.made_scenes import away, commands, scene


def falls(jacobian: int, iterations: int) -> np.ndarray:
    """(20, 7) poses of a block that falls askew on the table; a solver that may only take so many iterations."""
    made = MujocoWorld(scene(iterations=iterations))
    made.model.opt.jacobian = jacobian
    made.reset(away(), np.array([0.0, 0.0, 0.12, 0.2, 0.1, 0.0, np.sqrt(0.95)]))
    return np.stack([made.step(commands(away()), 0.05).body for _ in range(20)])


def test_steps_that_come_to_nothing_are_taken_anew_on_a_dense_jacobian() -> None:
    """With one iteration none converges: all of them are those of a dense world, to the bit. With enough, both agree."""
    sparse, dense = mujoco.mjtJacobian.mjJAC_SPARSE, mujoco.mjtJacobian.mjJAC_DENSE
    assert np.array_equal(falls(sparse, 1), falls(dense, 1))
    assert np.allclose(falls(sparse, 100), falls(dense, 100), atol=1e-3)
    assert not np.array_equal(falls(sparse, 100), falls(dense, 100))


class Refusing(MujocoWorld):
    """A world whose next moves come to nothing, so many of them."""

    refused = 0

    def _moved(self) -> bool:
        done = super()._moved()
        self.refused -= 1
        return done and self.refused < 0


@pytest.mark.parametrize("refused", [1, 2])
def test_a_step_that_diverges_is_taken_anew_and_then_in_smaller_ones(refused: int) -> None:
    """Wherever the others were refused, a block that falls is where it would be, and the next steps are as they ever were."""
    plain, other = MujocoWorld(scene()), Refusing(scene())
    ends = []
    for world in (plain, other):
        world.reset(away(), np.array([0.0, 0.0, 0.3, 0.0, 0.0, 0.0, 1.0]))
        other.refused = refused
        ends.append(np.stack([world.step(commands(away()), 0.05).body for _ in range(3)]))
    assert other.refused < 0
    assert np.allclose(*ends, atol=1e-4)
    assert other.model.opt.timestep == plain.model.opt.timestep


def test_a_world_that_diverges_however_small_the_step_says_so_and_begins_again_as_new() -> None:
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


def test_nothing_is_faster_after_a_step_than_bullet_lets_it() -> None:
    """Forces that drive the block to the bound, and to half of it."""
    world = MujocoWorld(scene())
    reached = []
    for newtons in (1.0, 0.5, 100.0):
        world.reset(away(), np.array([0.0, 0.0, 0.3, 0.0, 0.0, 0.0, 1.0]))
        world.push(np.array([newtons * world.scene.body.mass_kg * 100.0 / 0.05, 0.0, 0.0]), 0.05)
        reached.append(float(world.step(commands(away()), 0.05).velocity[0]))
    assert np.allclose(reached, [100.0, 50.0, 100.0], atol=1.5)
