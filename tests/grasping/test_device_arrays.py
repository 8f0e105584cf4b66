"""Worlds whose states, observations and rewards are tensors agree with those of numpy, in MuJoCo."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from afford.common.arrays import mapped, to_numpy
from afford.grasping.env import actions
from afford.grasping.env.arrays import NUMPY, Arrays
from afford.grasping.env.device_arrays import DeviceArrays
from afford.grasping.env.env import AffordanceGraspVector
from afford.grasping.env.flight_recorder import FlightRecorder, diverged
from afford.grasping.env.gym_env import PPOEnvAdapter
from afford.grasping.env.measures import EpisodeLog, measure
from afford.grasping.env.obs_blocks import LAYOUTS, ROLES, Snapshot, obs_blocks, observe
from afford.grasping.env.reward import REWARDS, reward_weights, rewards
from afford.grasping.imitation.tracking import FIELDS, ReferenceClips, Tracker, imitation_rewards, tracking_failed
from afford.grasping.policies.depth_cameras import CameraRig
from afford.grasping.policies.load_policy import load_policy
from afford.grasping.policies.student import StudentSensors
from afford.grasping.policies.student_obs import CloudSampling
from afford.grasping.policies.train_student import DistillationEnv, DistillationWorlds
from afford.grasping.rl import ppo
from afford.grasping.sim.engine import DivergedError
from afford.grasping.sim.scene import Physics
from tests.helpers.made_grasps import held_by_handle
from tests.helpers.made_hands import shadow
from tests.helpers.made_priors import reference_set, rehearsing
from tests.helpers.made_students import teacher

WORLDS, STEPS = 3, 7
TENSORS = DeviceArrays("cpu")


def vector(arrays: Arrays, **config: Any) -> AffordanceGraspVector:
    """Worlds of two tools, whose episodes end after STEPS."""
    tools = (held_by_handle(), held_by_handle("screwdriver"))
    return AffordanceGraspVector(WORLDS, shadow(), tools, None, arrays, **{"steps": STEPS, "start": "anywhere", **config})


def same(one: Any, other: Any) -> None:
    """Compare arrays with tensors."""
    np.testing.assert_allclose(to_numpy(other), one, rtol=0, atol=1e-5)


def compare_all(now: Snapshot, other: Snapshot) -> None:
    """Compare all layouts, roles and reward sets."""
    for layout in LAYOUTS:
        for role in ROLES:
            found = observe(obs_blocks(layout, role), other)
            assert found.dtype == torch.float32
            same(observe(obs_blocks(layout, role), now), found)
    for name in REWARDS:
        table = reward_weights(name, {"positive": -1.0})
        one, two = rewards(table, now.measures), rewards(table, other.measures)
        assert one.keys() == two.keys()
        for term in one:
            same(one[term], two[term])


def random_snapshot(now: Snapshot, rng: np.random.Generator) -> Snapshot:
    """Replace the state of a snapshot by random numbers, with the hand within reach of the object."""
    def turn() -> np.ndarray:
        found = rng.normal(size=(WORLDS, 4))
        return np.asarray(found / np.linalg.norm(found, axis=1)[:, None])

    shapes = {f.name: np.shape(getattr(now.state, f.name)) for f in fields(now.state)}
    state = replace(now.state, **{name: rng.normal(scale=0.1, size=shape) for name, shape in shapes.items()})
    for pose in (state.palm, state.body):
        pose[:, 3:] = turn()
    state = replace(state, force=abs(state.force), penetration_m=abs(np.asarray(state.penetration_m)), contacts=now.state.contacts)
    return replace(now, state=state, measures=measure(now.scenery, now.episode, state, now.action))


def in_tensors(now: Snapshot, arrays: DeviceArrays = TENSORS) -> Snapshot:
    """Convert a snapshot, with measurements that are computed from its tensors."""
    parts: Mapping[str, Any] = {name: mapped(getattr(now, name), arrays.own) for name in ("scenery", "episode", "state")}
    out = mapped(replace(now, **parts), arrays.own)
    return replace(out, measures=measure(out.scenery, out.episode, out.state, out.action))


def test_random_states_have_the_same_observations_and_rewards() -> None:
    """Compare layouts, roles and reward sets in states that no simulation reaches."""
    made, rng = vector(NUMPY), np.random.default_rng(0)
    made.reset(seed=0)
    now = made.core.snapshot()
    made.close()
    for _ in range(5):
        random = random_snapshot(now, rng)
        compare_all(random, in_tensors(random))


def test_a_control_step_reads_no_number_of_the_device() -> None:
    """Compute on the device meta, which has no numbers and refuses arrays of other devices."""
    made, meta = vector(NUMPY), DeviceArrays("meta")
    made.reset(seed=0)
    core = made.core
    now, u = in_tensors(core.snapshot(), meta), meta.own(core.sent)
    rates, limits, wrenches = (meta.own(x) for x in (core.rates, core._limits, actions.wrench_table(core._limits)))
    made.close()
    yaw, log = now.episode.yaw, EpisodeLog(WORLDS, STEPS, meta.own)
    log.record(now.measures, meta.own(np.zeros(WORLDS, int)))
    found = [diverged(now.state), log.depth_m, *actions.rate_command(u, actions.moved(rates, now.offset, u), yaw, limits),
             actions.wrench_command(u, now.state.q[:, :6], yaw, limits) / wrenches[:, 0]]  # fmt: skip
    found += [observe(obs_blocks(layout, "teacher"), now) for layout in LAYOUTS]
    found += [term for name in REWARDS for term in rewards(reward_weights(name), now.measures).values()]
    hand, clips = shadow(), reference_set().references
    table, clip = ReferenceClips(hand, clips, meta.own), meta.own(np.zeros(WORLDS, int))
    tracking = Tracker(hand, meta.own).compare(now.state, {name: table.at(name, clip, clip) for name in FIELDS})
    found += [tracking_failed(tracking, 0.1, now.phase)]
    found += [term for name in ("code", "paper") for term in imitation_rewards(name, tracking).values()]
    assert {one.device.type for one in found} == {"meta"}


@pytest.mark.parametrize("config", [{"base": "none", "layout": "small", "reward": "dense"},
                                    {"action_mode": "paper", "layout": "paper", "reward": "unidexgrasp++"},
                                    {"base": "none", "randomise": True, "push_n": 3.0, "layout": "points"}])  # fmt: skip
def test_episodes_in_tensors_are_those_in_arrays(config: dict[str, Any]) -> None:
    """Compare observations, rewards, ends, reports and resets with the same actions, and a return to a saved state."""
    pair, rng = [vector(NUMPY, **config), vector(TENSORS, **config)], np.random.default_rng(1)
    same(*(made.reset(seed=3)[0] for made in pair))
    for step in range(STEPS + 2):
        if step == 3:
            saved = [made.save() for made in pair]
        action = rng.uniform(-1, 1, (WORLDS, pair[0].core.motors))
        one, two = (made.advance(own(action)) for made, own in zip(pair, (NUMPY.own, TENSORS.own), strict=True))
        assert isinstance(two.reward, torch.Tensor)
        for name in ("obs", "final_obs", "reward", "terminated", "truncated", "success"):
            same(getattr(one, name), getattr(two, name))
        assert one.terms.keys() == two.terms.keys()
        assert one.report.keys() == two.report.keys()
        for name, figure in one.report.items():
            same(figure, two.report[name])
    compare_all(*(made.core.snapshot() for made in pair))
    same(*(made.restore(token) for made, token in zip(pair, saved, strict=True)))
    for made in pair:
        made.close()


def test_a_rollout_in_tensors_is_that_in_arrays() -> None:
    """Collect the same transitions, advantages and metrics with PPO."""
    found = []
    for arrays in (NUMPY, TENSORS):
        envs = vector(arrays)
        torch.manual_seed(0)
        model = ppo.ActorCritic(ppo.PolicyConfig(envs.core.width, envs.core.motors, (16,)))
        adapter = PPOEnvAdapter(envs, 5)
        found.append(ppo.collect_rollout(adapter, model, adapter.reset(), ppo.PPOConfig(steps=STEPS + 2))[0])
        envs.close()
    one, two = found
    assert one.metrics.keys() == two.metrics.keys()
    for name in one.metrics:
        assert two.metrics[name] == pytest.approx(one.metrics[name], abs=1e-5)
    for name in ("obs", "action", "log_prob", "advantage", "target"):
        np.testing.assert_allclose(getattr(two, name), getattr(one, name), atol=1e-4)


@pytest.mark.parametrize("reward", ["paper", "code"])
def test_imitation_in_tensors_is_that_in_arrays(reward: str) -> None:
    """Compare the expert's actions, observations, rewards, failures and reports of episodes that follow clips."""
    pair = [rehearsing(arrays, reward=reward, steps=20, shift_m=0.03, tolerance_m=0.02) for arrays in (NUMPY, TENSORS)]
    rngs = [np.random.default_rng(k) for k in range(2)]
    for made in pair:
        made.reset(range(2), [np.random.default_rng(k) for k in range(2)])
    for step in range(20):
        one, two = (made.expert() for made in pair)
        same(one, two)
        noise = 0.5 * np.random.default_rng(step).normal(size=one.shape)
        one, two = (made.step(action, rngs) for made, action in zip(pair, (one + noise, two + TENSORS.own(noise)), strict=True))
        for name in ("reward", "terminated", "truncated", "success"):
            same(getattr(one, name), getattr(two, name))
        for term in one.terms:
            same(one.terms[term], two.terms[term])
        same(*(made.observe() for made in pair))
    reports = [made.report() for made in pair]
    for name, figure in reports[0].items():
        same(figure, reports[1][name])
    for made in pair:
        made.close()


def test_a_student_observes_worlds_in_tensors(tmp_path: Path) -> None:
    """Compare point clouds, negative points, own numbers, and the labels of the teacher."""
    policy = load_policy(teacher(tmp_path), {})
    config = replace(policy.config("mujoco", Physics(), "flat", 0.0), steps=STEPS, base="none")
    found = []
    for arrays in (NUMPY, TENSORS):
        core = DistillationWorlds(shadow(), (held_by_handle(),), config, FlightRecorder(tmp_path, "mujoco", 0), arrays)
        sensors = StudentSensors(CameraRig(1, 32), CloudSampling(32), "tracked")
        envs = DistillationEnv(core, policy.actor(core), sensors, FlightRecorder(tmp_path, "mujoco", 0))
        seen = [*envs.begin(0)]
        for _ in range(2):
            other, label = envs.perturbed(np.random.default_rng(0))
            seen += [*other, label, envs.label(), *envs.step(np.full((1, 24), 0.2))]
        found.append(seen)
        core.close()
    for one, other in zip(*found, strict=True):
        assert isinstance(other, np.ndarray)
        np.testing.assert_allclose(other, one, atol=1e-3)  # clouds have 16 bits


def test_a_world_that_diverges_is_set_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its episode alone is terminated, its file is written, and observations stay finite; without a recorder it is an error."""
    recorder = FlightRecorder(tmp_path, "mujoco", 0)
    for kept in (recorder, None):
        made = AffordanceGraspVector(WORLDS, shadow(), (held_by_handle(),), kept, TENSORS)
        made.reset(seed=0)
        step = type(made.core.worlds).step

        def broken(worlds: Any, u: Any, control_s: float, step: Any = step) -> Any:
            found = step(worlds, u, control_s)
            found.q[1] = np.nan
            return found

        monkeypatch.setattr(type(made.core.worlds), "step", broken)
        if kept is None:
            with pytest.raises(DivergedError, match="diverged in world 1"):
                made.core.step(torch.zeros(WORLDS, 24), [])
        else:
            found = made.core.step(torch.zeros(WORLDS, 24), [])
            assert found.terminated.tolist() == [False, True, False]
            assert made.core.observe().isfinite().all()
            assert np.isnan(np.load(next(tmp_path.rglob("*-world-1.npz")))["q"]).all()
        monkeypatch.undo()
        made.close()


def test_actions_of_another_shape_are_refused() -> None:
    made = vector(TENSORS)
    made.reset(seed=0)
    with pytest.raises(ValueError, match="expected finite"):
        made.core.step(torch.zeros(WORLDS, 3), [])
    made.close()
