"""Teacher over a frozen prior: residual actions, the frozen prior, exact resumption."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from afford.common.files import tree
from afford.grasping.env.config import GraspEnvConfig
from afford.grasping.env.obs_blocks import block_slices, obs_blocks
from afford.grasping.env.step_result import StepResult
from afford.grasping.policies import train_teacher
from afford.grasping.policies.load_policy import load_policy, prior_columns
from afford.grasping.policies.train_teacher import FrozenPrior, ResidualEnv
from afford.grasping.rl import policy_files, ppo
from afford.grasping.rl.ppo import ActorCritic, PolicyConfig
from schemas.grasp import GraspTask
from schemas.training import Trained
from stages.grasping import rl_grasp_refinement as stage
from tests.helpers.made_grasps import held_by_handle
from tests.helpers.made_hands import shadow

PARAMS = stage.Params(updates=3, worlds=2, base="none", steps=4, epochs=2)


class RecordingEnvs:
    """Vector environment with random observations, which records its actions."""

    def __init__(self, width: int) -> None:
        self.obs = np.random.default_rng(0).normal(size=(9, 2, width)).astype(np.float32)
        self.actions: list[np.ndarray] = []

    def reset(self, seed: int) -> tuple[np.ndarray, dict[str, Any]]:
        return self.obs[0], {}

    def advance(self, action: np.ndarray) -> StepResult:
        self.actions.append(action)
        obs, no = self.obs[len(self.actions)], np.zeros(2, bool)
        return StepResult(np.zeros(2), no, no, obs=obs, final_obs=obs)


class Run:
    """A stage's context; dies when asked to."""

    def __init__(self, scratch: Path, dies_at: int = 0) -> None:
        self.scratch, self._dies_at = scratch, dies_at
        scratch.mkdir(exist_ok=True)

    def progress(self, done: int, total: int) -> None:
        if done == self._dies_at:
            raise KeyboardInterrupt


def prior(seed: int = 0) -> FrozenPrior:
    torch.manual_seed(seed)
    model = ActorCritic(PolicyConfig(len(prior_columns("small", "teacher")), 24, (8,)))
    torch.nn.init.normal_(model.actor[-1].weight, std=0.3)
    return FrozenPrior(model, "small")


def grasp_task() -> GraspTask:
    one = held_by_handle()
    negative = tuple(name for name, bad in zip(one.body.parts, one.negative, strict=True) if bad)
    return GraspTask("spatula/flip", "train", "flip an egg", one.body, negative, "handle", one.N_t, negative, np.zeros((0, 3)))


def trained(scratch: Path, dies_at: int = 0, **params: object) -> Trained:
    return stage.run(shadow(), ((grasp_task(),),), (), replace(PARAMS, **params), Run(scratch, dies_at))  # type: ignore[arg-type]


def content(made: Trained) -> dict[str, str]:
    return {file.name: file.digest for file in made.files.files}


def test_residual_actions_are_added_within_bounds() -> None:
    """Prior and residual are each within -1..1 before they are added, and so is their sum."""
    whole = obs_blocks("small", "teacher")
    first, envs = prior(), RecordingEnvs(sum(block.width for block in whole))
    residual, added = ResidualEnv(envs, first, seed=0), np.full((2, 24), 0.5)  # type: ignore[arg-type]  # only what it calls
    residual.reset()
    residual.step(added)
    residual.step(3 * added)
    for step, clipped in enumerate((added, np.ones((2, 24)))):
        np.testing.assert_allclose(envs.actions[step], (first.act(envs.obs[step]) + clipped).clip(-1, 1))


def test_prior_does_not_observe_negative_points() -> None:
    """Its columns are those of R, O and P; other values of N do not change its actions."""
    at, first = block_slices(obs_blocks("small", "teacher")), prior()
    one = np.random.default_rng(0).normal(size=(3, sum(block.width for block in obs_blocks("small", "teacher")))).astype(np.float32)
    other = one.copy()
    other[:, at["negative"].start :] += 1
    assert (first.act(one) == first.act(other)).all()
    with pytest.raises(ValueError, match=r"width 140 \(layout small"):
        FrozenPrior(ActorCritic(PolicyConfig(7, 24, (8,))), "small")


def test_training_leaves_the_prior_unchanged(tmp_path: Path) -> None:
    """Bit for bit, also as written into the teacher's folder; the teacher itself has changed."""
    first, before = prior(), {name: tensor.clone() for name, tensor in prior().model.state_dict().items()}
    plan = train_teacher.TeacherTrainingConfig(0, 2, "small", 0.1, 0.3, ppo.PPOConfig(updates=2, steps=3, epochs=2))
    config = GraspEnvConfig(base="none", start="anywhere", steps=3, reward="dense")
    model, state = train_teacher.train_teacher(shadow(), [held_by_handle()], first, config, plan, tmp_path,
                                               lambda done, total: None)  # fmt: skip
    policy = load_policy(tree("t", train_teacher.export_teacher(tmp_path, model, first, config, 0)), {})
    assert policy.prior is not None and policy.teacher is not None and state.step == 2
    assert all(torch.equal(before[name], tensor) for name, tensor in policy.prior.state_dict().items())
    untrained = train_teacher.new_teacher(plan, model.config.observation, 24).state_dict()
    assert not torch.equal(untrained["actor.0.weight"], policy.teacher.state_dict()["actor.0.weight"])


def test_killed_training_resumes_to_the_same_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Killed within the second of three sections; another seed gives other bytes."""
    monkeypatch.setattr(train_teacher, "SECTION", 1)
    whole = content(trained(tmp_path / "whole"))
    with pytest.raises(KeyboardInterrupt):
        trained(tmp_path / "killed", dies_at=2)
    assert content(trained(tmp_path / "killed")) == whole
    assert content(trained(tmp_path / "other", seed=1)) != whole


def test_outputs_of_a_training(tmp_path: Path) -> None:
    """A policy that can be loaded, the facts of its environment, and curves of every update."""
    made = trained(tmp_path / "run", lambda_n=0.0)
    policy = load_policy(made.files, {})
    assert policy.teacher is not None and policy.prior is None
    config = policy.config("bullet", GraspEnvConfig().physics, "flat", 0.0)
    assert (config.base, config.start, config.steps, config.reward) == ("none", "anywhere", 4, "dense")
    assert config.weights["negative_near"] == 0
    curves = {curve.name: curve for curve in made.log.curves}
    assert {"train.success", "train.as_violation_pct", "train.reward/gripped_goal", "train.kl", "train.std"} <= set(curves)
    assert curves["train.kl"].step.tolist() == [1, 2, 3] and made.log.steps == 3
    facts = json.loads(next(file for file in made.files.files if file.name == policy_files.CONFIG).path.read_text())["facts"]
    assert facts["role"] == "teacher" and facts["seed"] == 0


@pytest.mark.parametrize(("wrong", "says"), [
    (partial(trained, base="prior"), "a prior where base=prior"), (partial(trained, size="huge"), "small or paper, got 'huge'"),
    (partial(trained, lambda_n=-1.0), "lambda_n of 0 or more"), (partial(trained, reward="best"), "got 'best'")])  # fmt: skip
def test_wrong_parameters_are_refused(tmp_path: Path, wrong: Callable[[Path], Trained], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        wrong(tmp_path / "run")


def test_tasks_have_at_least_one_world_each() -> None:
    for worlds, expected in ((2, 5), (6, 6)):
        assert stage._training_config(stage.Params(worlds=worlds), 5).worlds == expected
