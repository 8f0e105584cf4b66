"""What MuJoCo's world does by itself; the contract is tested in test_engines.py."""

from __future__ import annotations

import mujoco
import numpy as np

from afford.sim.mujoco_world import MujocoWorld
from tests.made_scenes import away, commands, scene


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
