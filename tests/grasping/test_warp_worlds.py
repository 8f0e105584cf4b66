"""Warp worlds agree with MuJoCo up to 32-bit precision; on the CPU, skipped without the extra `gpu`."""

from __future__ import annotations

import importlib.util
from dataclasses import fields

import numpy as np
import pytest

from afford.common.registry import extra
from afford.grasping.env.arrays import NUMPY
from afford.grasping.env.device_arrays import DeviceArrays
from afford.grasping.env.env import AffordanceGraspVector
from afford.grasping.env.task import make_task
from afford.grasping.sim.engine import State
from afford.grasping.sim.scene import Scene, randomize_physics
from afford.grasping.sim.worlds import ThreadWorlds, world_batch
from tests.grasping.test_engines import above_block
from tests.helpers.made_hands import shadow
from tests.helpers.made_scenes import at, away, block, commands, scene, tool

CONTROL_S = 0.05
there = pytest.mark.skipif(not (importlib.util.find_spec("mujoco_warp") and importlib.util.find_spec("warp")),
                           reason="the extra gpu is not installed")  # fmt: skip


def scenes() -> list[Scene]:
    """Two objects in turn with different physics: every batched field differs."""
    return [randomize_physics(scene(block()), 1), scene(tool()), randomize_physics(scene(block()), 2)]


def closing(k: int) -> np.ndarray:
    """Return (24,) commands of fingers that close on the block."""
    u = commands(above_block())
    u[[7, 8, 10, 11, 13, 14, 17, 18]] = 0.15 + 0.9 * min(1.0, k / 8)
    u[20] = 1.15 * min(1.0, k / 8)
    return u


def same(one: State, two: State) -> bool:
    return all(np.array_equal(getattr(one, f.name), getattr(two, f.name)) for f in fields(State))


def test_missing_extra_and_invalid_options() -> None:
    """Errors name the extra, engines with a device, and options of warp."""
    with pytest.raises(ValueError, match="no_such is not installed; run `make setup EXTRA=gpu`"):
        extra("no_such", "gpu")
    with pytest.raises(ValueError, match="device: expected cpu with the engine mujoco"):
        world_batch("mujoco", scenes(), device="cuda")
    with pytest.raises(ValueError, match="warp: expected one thread and one process"):
        world_batch("warp", scenes(), processes=2)


@there
@pytest.mark.slow
def test_closing_fingers_are_those_of_mujoco() -> None:
    """Joints agree to 0.1 mrad, objects to 2 mm, and contacts are on the same parts, over 12 control steps.

    The same commands give the same bits, also after `restore`.
    """
    one, two = ThreadWorlds("mujoco", scenes()), world_batch("warp", scenes())
    q, body = np.tile(above_block(), (3, 1)), np.stack([at(), at(), at()])
    one.reset(q, body)
    two.reset(q, body)
    run = list[State]()
    for k in range(12):
        u = np.tile(closing(k), (3, 1))
        theirs, ours = one.step(u, CONTROL_S), two.step(u, CONTROL_S)
        run.append(ours)
        assert ours.q == pytest.approx(theirs.q, abs=1e-4)
        assert ours.tips == pytest.approx(theirs.tips, abs=1e-4)
        assert ours.body == pytest.approx(theirs.body, abs=2e-3)
        assert ours.penetration_m == pytest.approx(theirs.penetration_m, abs=1e-4)
        assert np.array_equal(ours.force > 0.05, theirs.force > 0.05)
    assert (run[-1].contacts[[0, 2]] > 0).all()
    two.reset(q, body)
    for k, first in enumerate(run):
        if k == 6:
            token = two.save()
        assert same(first, two.step(np.tile(closing(k), (3, 1)), CONTROL_S))
    assert same(two.restore(token), run[5])
    assert same(run[6], two.step(np.tile(closing(6), (3, 1)), CONTROL_S))
    one.close()
    two.close()
    two.close()


@there
@pytest.mark.slow
def test_pushes_resets_and_bad_commands() -> None:
    """A push acts on its own world, a reset leaves the others, and invalid commands are rejected."""
    made = world_batch("warp", [scene(gravity_m_s2=0.0)] * 3)
    made.reset(np.tile(away(), (3, 1)), np.tile(at(z=0.5), (3, 1)))
    made.push(np.array([[0.5, 0.0, 0.0]]), 0.075, [1])
    u = np.tile(commands(away()), (3, 1))
    for _ in range(2):
        found = made.step(u, CONTROL_S)
    assert found.velocity == pytest.approx(np.outer([0, 0.5 * 0.075 / block().mass_kg, 0], [1, 0, 0]), rel=1e-3, abs=1e-5)
    assert made.reset(away()[None], at(z=1.0)[None], [0]).body[0, 2] == 1.0
    after = made.state()
    assert np.array_equal(after.body[1:], found.body[1:])
    assert np.array_equal(after.velocity[0], np.zeros(3))
    with pytest.raises(ValueError, match="step, u: expected finite"):
        made.step(np.full((3, 24), np.nan), CONTROL_S)
    with pytest.raises(ValueError, match="device: expected cpu, cuda or cuda:N"):
        world_batch("warp", [scene()], device="tpu")


@there
@pytest.mark.slow
def test_tensors_of_two_groups_are_the_arrays() -> None:
    """Observations and rewards on the device are those of numpy for two objects, also after a reset of one world."""
    tasks = [make_task(tool("spatula"), ["handle"]), make_task(tool(), ["shaft"])]
    pair = [AffordanceGraspVector(3, shadow(), tasks, None, arrays, engine="warp", base="script", reward="dense")
            for arrays in (NUMPY, DeviceArrays("cpu"))]  # fmt: skip
    for made in pair:
        made.reset(seed=0)
    for step in range(16):
        if step == 8:
            for made in pair:
                made.core.reset([1], [np.random.default_rng(k) for k in range(3)])
        one, two = (made.advance(np.zeros((3, 24))) for made in pair)
        np.testing.assert_allclose(two.obs.numpy(), one.obs, atol=1e-5)
        np.testing.assert_allclose(two.reward.numpy(), one.reward, atol=1e-5)
    assert pair[0].core.measures().force_held.any()
    for made in pair:
        made.close()


@there
@pytest.mark.slow
def test_a_scripted_grasp_is_held_in_both() -> None:
    """Episodes in the environment without actions agree, and the tool ends at its goal."""
    ends = {}
    for engine in ("mujoco", "warp"):
        made = AffordanceGraspVector(2, shadow(), [make_task(tool(), ["shaft"])], engine=engine, base="script")
        made.reset(seed=0)
        rows = [made.core.state().body]
        for _ in range(39):
            made.step(np.zeros((2, 24)))
            rows.append(made.core.state().body)
        ends[engine] = np.array(rows), made.core.measures().goal_m
        made.close()
    first, second = ends["mujoco"], ends["warp"]
    assert first[0][:12, :, :3] == pytest.approx(second[0][:12, :, :3], abs=2e-3)
    assert (first[1] < 0.05).all()
    assert (second[1] < 0.05).all()
