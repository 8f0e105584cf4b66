"""Wrench actions: forces and torques, a weightless hand, agreement of engines, a grasp that succeeds."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from scipy.spatial.transform import Rotation

from afford.grasping.env.actions import (
    FORCE_N,
    TORQUE_NM,
    WRENCH_CONTROL_S,
    hinges,
    script_steps,
    scripted,
    turned,
    wrench_command,
    wrench_table,
)
from afford.grasping.env.config import GraspEnvConfig
from afford.grasping.env.grasp_worlds import GraspWorlds
from afford.grasping.env.rollout import rollout
from afford.grasping.env.scenery import to_frame
from afford.grasping.hand.kinematics import command_limits, commanded_columns
from afford.grasping.sim.engine import CONTROL_S, State, World, make_world
from afford.grasping.sim.scene import STRICT, Physics, Scene, hold_command
from tests.helpers.made_grasps import env, held_by_handle
from tests.helpers.made_hands import shadow
from tests.helpers.made_scenes import tool

ENGINES = ("bullet", "mujoco")
LIMITS = command_limits(shadow().joints)
PALM_M = (0.0907065702865, -0.0322338893096, 0.2487902976383, 0.1425599214398, -0.7731875409529, -0.6155167648123, 0.0547431050383)
"""of a hand in rates, before there were wrenches"""


PULL_N_M, HOLD_N_S_M = 1600.0, 80.0
"""spring of the slides, and what drag takes (scene.py) is given back"""
PULL_NM_RAD, HOLD_NM_S_RAD = 6.0, 0.3
"""of the hinges"""


def action_for(efforts: np.ndarray, fingers: np.ndarray, q_wrist: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """(n, m) actions of efforts (n, 6) on the gantry and targets (n, m - 6) of the fingers; the inverse of wrench_command."""
    torque = np.linalg.solve(hinges(q_wrist), efforts[:, 3:, None])[..., 0]
    low, high = LIMITS[6:].T
    parts = (turned(efforts[:, :3], -yaw) / FORCE_N, turned(torque, -yaw) / TORQUE_NM, (2 * fingers - low - high) / (high - low))
    return np.concatenate(parts, axis=1).clip(-1, 1)


class SpringScript:
    """Scripted grasp by wrenches: springs pull the wrist along the path of the script."""

    def __init__(self) -> None:
        self._path: np.ndarray | None = None

    def act(self, now: GraspWorlds) -> np.ndarray:
        """(n, m)."""
        q = now.state().q[:, commanded_columns(now.scenes[0].hand.joints)]
        if self._path is None or not now.steps_done().any():
            lift_m = now.config.lift_m
            path = [scripted(scene, aim, script_steps(lift_m), lift_m) for scene, aim in zip(now.scenes, now.aims, strict=True)]
            self._path = np.concatenate([q[:, None], np.stack(path)], axis=1)
        wanted, speed = _at(self._path, (now.steps_done() + 1) * now.config.control_s)
        error = wanted[:, :6] - q[:, :6]
        pull, drag = np.repeat([PULL_N_M, PULL_NM_RAD], 3), np.repeat([HOLD_N_S_M, HOLD_NM_S_RAD], 3)
        efforts = pull * error + drag * speed[:, :6]
        return action_for(efforts, wanted[:, 6:], q[:, :6], now.episode.yaw)


def _at(path: np.ndarray, time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n, m) where paths (n, t, m) of the script's own steps are at times (n,), and how fast they go."""
    at = np.minimum(time_s / CONTROL_S, path.shape[1] - 1)
    low, rows = np.minimum(at.astype(int), path.shape[1] - 2), np.arange(len(path))
    before, after = path[rows, low], path[rows, low + 1]
    moving = (at < path.shape[1] - 1)[:, None]
    return before + (at - low)[:, None] * (after - before), moving * (after - before) / CONTROL_S


def wrenched(engine: str, **physics: Any) -> tuple[World, np.ndarray]:
    """A world whose wrist takes forces, far above its object; the command that keeps it there."""
    scene = Scene(shadow(), tool("screwdriver"), Physics(**physics), "wrench")
    made, q = make_world(engine, scene), np.zeros(28)
    q[2] = 0.8
    made.reset(q, np.array([0.9, 0.9, 0.02, 0, 0, 0, 1.0]))
    return made, hold_command(scene, q)


def after(made: World, u: np.ndarray, steps: int) -> State:
    for _ in range(steps):
        state = made.step(u, WRENCH_CONTROL_S)
    return state


@pytest.mark.parametrize("engine", ENGINES)
def test_hand_without_forces_does_not_move(engine: str) -> None:
    """Hand at rest for a second, to the millimetre, since it has no weight; the object has, and rests."""
    made, u = wrenched(engine)
    state = after(made, u, 60)
    assert np.abs(state.q[:3] - (0, 0, 0.8)).max() < 1e-3 and np.abs(state.q[3:6]).max() < 5e-3
    assert state.body[2] < 0.04 and np.linalg.norm(state.velocity) < 0.05
    made.close()


@pytest.mark.parametrize("engine", ENGINES)
def test_constant_force_accelerates_by_newtons_law(engine: str) -> None:
    """v = F t / m without drag, where m is the mass on the slide; with drag the final speed is F / (m drag)."""
    mass = 0.611 + 3 * 0.05
    free, u = wrenched(engine, drag_1_s=0.0)
    u[2] = 2.0
    assert after(free, u, 6).qd[2] == pytest.approx(2.0 * 0.1 / mass, rel=0.02)
    slow, u = wrenched(engine)
    u[2] = 20.0
    assert after(slow, u, 30).qd[2] == pytest.approx(20.0 / (mass * 100), rel=0.02)
    u[2] = 0.0
    assert after(slow, u, 30).qd[2] == pytest.approx(0, abs=1e-3)
    free.close()
    slow.close()


def test_engines_agree_on_wrenches() -> None:
    """A quarter of a second of forces and torques: 3 mm and 0.03 rad."""
    rng = np.random.default_rng(0)
    pushes, found = rng.uniform(-1, 1, (15, 6)) * [40, 40, 40, 0.5, 0.5, 0.5], []
    for engine in ENGINES:
        made, u = wrenched(engine, rate_hz=480)
        for push in pushes:
            u[:6] = push
            state = made.step(u, WRENCH_CONTROL_S)
        found.append(state)
        made.close()
    assert np.abs(found[0].q[:3] - found[1].q[:3]).max() < 3e-3 and np.abs(found[0].q[3:6] - found[1].q[3:6]).max() < 0.03
    assert np.abs(found[0].q[:6]).max() > 0.02 and np.allclose(found[0].torque[:6], found[1].torque[:6])


def test_wrench_command_is_a_force_and_a_torque_on_the_palm() -> None:
    """Hinges are the axes of the palm's rotation; forces are along the frame."""
    rng = np.random.default_rng(0)
    q, yaw, action = rng.uniform(-0.8, 0.8, (5, 6)), rng.uniform(-3, 3, 5), rng.uniform(-1, 1, (5, 24))
    small, axes = 1e-6, hinges(q)
    for k in range(3):
        moved = q.copy()
        moved[:, 3 + k] += small
        turns = Rotation.from_euler("ZYX", moved[:, 3:]) * Rotation.from_euler("ZYX", q[:, 3:]).inv()
        assert np.allclose(turns.as_rotvec() / small, axes[:, k], atol=1e-5)
    u = wrench_command(action, q, yaw, LIMITS)
    assert np.allclose(action_for(u[:, :6], u[:, 6:], q, yaw), action)
    assert np.allclose(to_frame(u[:, :3], yaw), FORCE_N * action[:, :3])
    assert ((u[:, 6:] >= LIMITS[6:, 0] - 1e-12) & (u[:, 6:] <= LIMITS[6:, 1] + 1e-12)).all()
    assert np.allclose(wrench_table(LIMITS)[6:, 0], np.ptp(LIMITS[6:], axis=1) / 2)


@pytest.mark.parametrize("engine", ENGINES)
def test_scripted_wrenches_succeed(engine: str) -> None:
    """Three objects, strict physics, 200 steps at 60 Hz: two or more reach the goal, so the reward is attainable."""
    tasks = [held_by_handle(), held_by_handle("screwdriver"), held_by_handle("knife", 3)]
    core = GraspWorlds(shadow(), tasks, GraspEnvConfig(engine=engine, physics=STRICT, action_mode="paper", steps=200))
    played = rollout(core, SpringScript(), [np.random.default_rng(k) for k in range(3)])
    assert played.report["success"].sum() >= 2 and played.report["held"].sum() >= 2
    assert played.rate_hz == pytest.approx(60) and played.q.shape[1] == 201 and np.abs(played.action).max() <= 1
    core.close()


@pytest.mark.filterwarnings("ignore:.*WARN")
@pytest.mark.parametrize("engine", ENGINES)
def test_check_env_and_restore(engine: str) -> None:
    """check_env finds no fault; after a restore random actions give the same observations bit for bit."""
    made = env(engine=engine, action_mode="paper", steps=20)
    check_env(made, skip_render_check=True)
    made.reset(seed=1)
    actions = np.random.default_rng(0).uniform(-1, 1, (12, 24)).astype(np.float32)
    for action in actions[:4]:
        made.step(action)
    token = made.save()
    first = [made.step(action)[0] for action in actions[4:]]
    made.restore(token)
    assert all(np.array_equal(one, made.step(action)[0]) for one, action in zip(first, actions[4:], strict=True))
    made.close()


def test_rate_actions_reach_recorded_poses() -> None:
    """Servos with weight, 20 actions per second: recorded poses of a hand, to the micrometre."""
    config = GraspEnvConfig()
    assert (config.action_mode, config.control_s, Scene(shadow(), tool("screwdriver")).wrist) == ("rate", 0.05, "servo")
    made = env(engine="mujoco", layout="small")
    made.reset(seed=3)
    for action in np.random.default_rng(2).uniform(-1, 1, (5, 24)):
        made.step(action)
    state = made.core.state()
    assert state.palm[0] == pytest.approx(PALM_M, abs=1e-6)
    made.close()


def test_bases_are_refused_with_wrenches() -> None:
    """A base gives targets, which wrenches do not have."""
    for base in ("script", "prior"):
        with pytest.raises(ValueError, match="does not fit action_mode=paper"):
            GraspEnvConfig(action_mode="paper", base=base, posture=(0.0,) * 24)
    with pytest.raises(ValueError, match="expected servo or wrench"):
        Scene(shadow(), tool("screwdriver"), wrist="rope")
