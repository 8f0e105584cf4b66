"""Batches of worlds, on threads and in processes, equal single worlds."""

from __future__ import annotations

import os
import signal
from dataclasses import fields

import numpy as np
import psutil
import pytest

from afford.grasping.sim.engine import BACKENDS, State, make_world
from afford.grasping.sim.scene import randomize_physics
from afford.grasping.sim.worlds import ProcessWorlds, ThreadWorlds, world_batch
from tests.helpers.made_scenes import at, away, block, commands, scene, tool

CONTROL_S = 0.05
SCENES = [randomize_physics(scene(body), seed) for seed, body in enumerate((block(), tool(), block()))]
Q, BODY = np.tile(away(), (3, 1)), np.stack([at(z=0.05 * k) for k in range(3)])
U = np.tile(commands(away()), (3, 1)) + np.arange(3)[:, None] * 0.1


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("engine", sorted(BACKENDS))
def test_thread_worlds_equal_single_worlds(engine: str, threads: int) -> None:
    """Different objects and physics, on one thread and on two: the same bits as single worlds."""
    together = ThreadWorlds(engine, SCENES, threads)
    together.reset(Q, BODY)
    for _ in range(4):
        found = together.step(U, CONTROL_S)
    for k, one in enumerate(SCENES):
        alone = make_world(engine, one)
        alone.reset(Q[k], BODY[k])
        for _ in range(4):
            state = alone.step(U[k], CONTROL_S)
        alone.close()
        for name in (f.name for f in fields(State) if f.name != "force"):
            assert np.array_equal(getattr(found, name)[k], getattr(state, name)), name
        assert np.array_equal(found.force[k, :, : len(one.body.parts)], state.force)
    together.close()
    together.close()


def test_reset_of_some_worlds_leaves_the_others() -> None:
    """Reset of one world does not move the others."""
    together = ThreadWorlds("mujoco", [scene()] * 3)
    together.reset(np.tile(away(), (3, 1)), np.tile(at(z=0.3), (3, 1)))
    before = together.step(np.tile(commands(away()), (3, 1)), CONTROL_S)
    assert together.reset(away()[None], at(z=1.0)[None], which=[1]).body[0, 2] == 1.0
    after = together.state()
    assert np.array_equal(after.body[[0, 2]], before.body[[0, 2]])
    assert after.body[1, 2] == 1.0
    together.close()


def test_empty_batches_are_rejected() -> None:
    """No scenes and no threads are rejected."""
    with pytest.raises(ValueError, match="one scene or more"):
        ThreadWorlds("mujoco", [])
    with pytest.raises(ValueError, match="one thread or more"):
        ThreadWorlds("mujoco", [scene()], threads=0)


def same(one: State, two: State) -> bool:
    return all(np.array_equal(getattr(one, f.name), getattr(two, f.name)) for f in fields(State))


def test_process_worlds_equal_thread_worlds() -> None:
    """Resets of all and of some, steps, pushes of some, saved states and a single world give the same bits."""
    one, two = ThreadWorlds("bullet", SCENES), world_batch("bullet", SCENES, processes=2)
    assert isinstance(two, ProcessWorlds)
    assert same(one.reset(Q, BODY), two.reset(Q, BODY))
    assert same(one.step(U, CONTROL_S), two.step(U, CONTROL_S))
    for both in (one, two):
        both.push(np.array([[0.5, 0.0, 0.0], [0.0, 0.5, 0.0]]), 0.1, [2, 0])
    assert same(one.step(U, CONTROL_S), two.step(U, CONTROL_S))
    tokens = one.save(), two.save()
    after = one.step(U, CONTROL_S)
    assert same(after, two.step(U, CONTROL_S))
    assert same(one.reset(Q[[2, 0]], BODY[[0, 1]], [2, 0]), two.reset(Q[[2, 0]], BODY[[0, 1]], [2, 0]))
    assert same(one.reset(Q[[1]], BODY[[1]], [1]), two.reset(Q[[1]], BODY[[1]], [1]))
    assert same(one.state(), two.state())
    assert same(one.restore(tokens[0]), two.restore(tokens[1]))
    assert same(after, one.step(U, CONTROL_S))
    assert same(after, two.step(U, CONTROL_S))
    assert same(one.single_world(2).step(U[2], CONTROL_S), two.single_world(2).step(U[2], CONTROL_S))
    one.close()
    two.close()
    two.close()


def test_errors_of_processes() -> None:
    """Invalid commands raise the error of the world, and later requests still match their replies.

    The error about a killed process names objects and exit code; closing still works, and no process remains.
    """
    before = set(psutil.Process().children())
    made = ProcessWorlds("mujoco", SCENES[:2], processes=2)
    mine = sorted(set(psutil.Process().children()) - before, key=lambda child: child.create_time())
    workers = [child for child in mine if "spawn_main" in " ".join(child.cmdline())]
    made.reset(Q[:2], BODY[:2])
    with pytest.raises(ValueError, match="finite"):
        made.step(np.full((2, 24), np.nan), CONTROL_S)
    assert made.step(U[:2], CONTROL_S).q.shape == (2, 28)
    os.kill(workers[0].pid, signal.SIGKILL)
    with pytest.raises(RuntimeError, match=r"worlds with block: their process ended \(exit code -9\)"):
        made.reset(Q[:2], BODY[:2])
    made.close()
    assert not any(child.is_running() and child.status() != psutil.STATUS_ZOMBIE for child in workers)


def test_an_unknown_engine_in_a_process() -> None:
    with pytest.raises(KeyError, match="bullet, mujoco"):
        ProcessWorlds("isaac", SCENES[:1], processes=1)
