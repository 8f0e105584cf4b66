"""Worlds in processes are the same worlds as in one."""

from __future__ import annotations

import os
import signal
from dataclasses import fields

import numpy as np
import psutil
import pytest

from afford.grasping.sim.engine import State
from afford.grasping.sim.scene import randomize_physics
from afford.grasping.sim.worlds import ProcessWorlds, ThreadWorlds, world_batch
from tests.helpers.made_scenes import at, away, block, commands, scene, tool

CONTROL_S = 0.05
SCENES = [randomize_physics(scene(body), seed) for seed, body in enumerate((block(), tool(), block()))]
Q, BODY = np.tile(away(), (3, 1)), np.stack([at(z=0.05 * k) for k in range(3)])
U = np.tile(commands(away()), (3, 1)) + np.arange(3)[:, None] * 0.1


def same(one: State, two: State) -> bool:
    return all(np.array_equal(getattr(one, f.name), getattr(two, f.name)) for f in fields(State))


def test_two_processes_give_the_bits_of_one() -> None:
    """Resets of all and of some in any order, steps, pushes of some, what was saved, one world by itself."""
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
    assert same(one.alone(2).step(U[2], CONTROL_S), two.alone(2).step(U[2], CONTROL_S))
    one.close()
    two.close()
    two.close()


def test_errors_of_a_process_are_raised_here_and_it_goes_on() -> None:
    """Bad commands are refused with the sentence of the world that got them; afterwards questions and answers still match."""
    made = ProcessWorlds("mujoco", SCENES[:2], processes=2)
    made.reset(Q[:2], BODY[:2])
    with pytest.raises(ValueError, match="finite"):
        made.step(np.full((2, 24), np.nan), CONTROL_S)
    assert made.step(U[:2], CONTROL_S).q.shape == (2, 28)
    made.close()
    with pytest.raises(KeyError, match="bullet, mujoco"):
        ProcessWorlds("isaac", SCENES[:2], processes=2)


def test_a_process_that_died_is_told() -> None:
    """In one sentence that names its objects and its exit code; closing is still possible, and nothing stays behind."""
    before = set(psutil.Process().children())
    made = ProcessWorlds("mujoco", SCENES[:2], processes=2)
    mine = sorted(set(psutil.Process().children()) - before, key=lambda child: child.create_time())
    workers = [child for child in mine if "spawn_main" in " ".join(child.cmdline())]
    os.kill(workers[0].pid, signal.SIGKILL)
    with pytest.raises(RuntimeError, match=r"worlds with block: expected their process to answer.*exit code -9"):
        made.reset(Q[:2], BODY[:2])
    made.close()
    assert not any(child.is_running() and child.status() != psutil.STATUS_ZOMBIE for child in workers)
