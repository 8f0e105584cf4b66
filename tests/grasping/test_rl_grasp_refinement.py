"""A teacher over a frozen prior: the sum, what stays as it was, and that a kill changes nothing."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch

from afford.common.files import tree
from afford.grasping.env.config import Config
from afford.grasping.env.observe import blocks, slices
from afford.grasping.policies import refine
from afford.grasping.policies.acting import load, prior_columns
from afford.grasping.policies.residual import OverBase, Prior
from afford.grasping.rl import ppo, saved
from afford.grasping.rl.policy import ActorCritic, PolicyConfig
from schemas.grasp import GraspTask
from schemas.training import Trained
from stages.grasping import rl_grasp_refinement as stage
from tests.helpers.made_grasps import held_by_handle
from tests.helpers.made_hands import shadow

PARAMS = stage.Params(updates=3, worlds=2, base="none", steps=4, epochs=2)


class Noting:
    """Environments that show random numbers and keep what is done."""

    def __init__(self, width: int) -> None:
        self.shown = np.random.default_rng(0).normal(size=(9, 2, width)).astype(np.float32)
        self.done: list[np.ndarray] = []

    def reset(self) -> np.ndarray:
        return self.shown[0]

    def step(self, action: np.ndarray) -> ppo.Moved:
        self.done.append(action)
        seen, no = self.shown[len(self.done)], np.zeros(2, bool)
        return ppo.Moved(seen, seen, np.zeros(2), no, no, {})


class Run:
    """A stage's context; dies when asked to."""

    def __init__(self, scratch: Path, dies_at: int = 0) -> None:
        self.scratch, self._dies_at = scratch, dies_at
        scratch.mkdir(exist_ok=True)

    def progress(self, done: int, total: int) -> None:
        if done == self._dies_at:
            raise KeyboardInterrupt


def prior(seed: int = 0) -> Prior:
    torch.manual_seed(seed)
    model = ActorCritic(PolicyConfig(len(prior_columns("small", "teacher")), 24, (8,)))
    torch.nn.init.normal_(model.actor[-1].weight, std=0.3)
    return Prior(model, "small")


def grasp_task() -> GraspTask:
    one = held_by_handle()
    negative = tuple(name for name, bad in zip(one.body.parts, one.negative, strict=True) if bad)
    return GraspTask("spatula/flip", "train", "flip an egg", one.body, negative, "handle", one.N_t, negative, np.zeros((0, 3)))


def trained(scratch: Path, dies_at: int = 0, **params: object) -> Trained:
    return stage.run(shadow(), ((grasp_task(),),), (), replace(PARAMS, **params), Run(scratch, dies_at))  # type: ignore[arg-type]


def content(made: Trained) -> dict[str, str]:
    return {file.name: file.digest for file in made.files.files}


def test_what_acts_is_the_sum_within_bounds() -> None:
    """Each of the two is within -1..1 before it is added, the sum after; without a prior the action alone."""
    whole = blocks("small", "teacher")
    first, envs = prior(), Noting(sum(block.width for block in whole))
    over, added = OverBase(envs, first), np.full((2, 24), 0.5)
    over.reset()
    over.step(added)
    over.step(3 * added)
    for step, wanted in enumerate((added, np.ones((2, 24)))):
        np.testing.assert_allclose(envs.done[step], (first.act(envs.shown[step]) + wanted).clip(-1, 1))
    alone = Noting(3)
    OverBase(alone, None).step(4 * added)
    assert (alone.done[0] == 1).all()


def test_a_prior_sees_no_negative_points() -> None:
    """Its columns are those of R, O and P; what stands in N does not change what it does."""
    at, first = slices(blocks("small", "teacher")), prior()
    one = np.random.default_rng(0).normal(size=(3, sum(block.width for block in blocks("small", "teacher")))).astype(np.float32)
    other = one.copy()
    other[:, at["negative"].start :] += 1
    assert (first.act(one) == first.act(other)).all()
    with pytest.raises(ValueError, match="140 numbers of layout small"):
        Prior(ActorCritic(PolicyConfig(7, 24, (8,))), "small")


def test_training_leaves_the_prior_as_it_was(tmp_path: Path) -> None:
    """To the bit, also as it is written into the teacher's folder; the teacher itself has changed."""
    first, before = prior(), {name: tensor.clone() for name, tensor in prior().model.state_dict().items()}
    plan = refine.Plan(0, 2, "small", 0.1, 0.3, ppo.Config(updates=2, steps=3, epochs=2))
    config = Config(base="none", start="anywhere", steps=3, reward="dense")
    model, state = refine.train(shadow(), [held_by_handle()], first, config, plan, tmp_path, lambda done, total: None)
    policy = load(tree("t", refine.write(tmp_path, model, first, config, 0)), {})
    assert policy.prior is not None and policy.teacher is not None and state.step == 2
    assert all(torch.equal(before[name], tensor) for name, tensor in policy.prior.state_dict().items())
    untrained = refine.made(plan, model.config.observation, 24).state_dict()
    assert not torch.equal(untrained["actor.0.weight"], policy.teacher.state_dict()["actor.0.weight"])


def test_killed_it_ends_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Within the second section of three; the same bytes as without; another seed gives others."""
    monkeypatch.setattr(refine, "SECTION", 1)
    whole = content(trained(tmp_path / "whole"))
    with pytest.raises(KeyboardInterrupt):
        trained(tmp_path / "killed", dies_at=2)
    assert content(trained(tmp_path / "killed")) == whole
    assert content(trained(tmp_path / "other", seed=1)) != whole


def test_what_it_leaves(tmp_path: Path) -> None:
    """A policy that can be run again, with what must be known of its environment, and curves of every update."""
    made = trained(tmp_path / "run", lambda_n=0.0)
    policy = load(made.files, {})
    assert policy.teacher is not None and policy.prior is None
    config = policy.config("bullet", Config().physics, "flat", 0.0)
    assert (config.base, config.start, config.steps, config.reward) == ("none", "anywhere", 4, "dense")
    assert config.weights["negative_near"] == 0
    curves = {curve.name: curve for curve in made.log.curves}
    assert {"train.success", "train.as_violation_pct", "train.reward/gripped_goal", "train.kl", "train.std"} <= set(curves)
    assert curves["train.kl"].step.tolist() == [1, 2, 3] and made.log.steps == 3
    facts = json.loads(next(file for file in made.files.files if file.name == saved.CONFIG).path.read_text())["facts"]
    assert facts["role"] == "teacher" and facts["seed"] == 0


@pytest.mark.parametrize(("wrong", "says"), [
    (partial(trained, base="prior"), "a prior where base=prior"), (partial(trained, size="huge"), "small or paper, got 'huge'"),
    (partial(trained, lambda_n=-1.0), "lambda_n of 0 or more"), (partial(trained, reward="best"), "got 'best'")])  # fmt: skip
def test_what_cannot_be_is_said(tmp_path: Path, wrong: Callable[[Path], Trained], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        wrong(tmp_path / "run")


def test_every_task_has_a_world() -> None:
    assert stage._plan(stage.Params(worlds=2), 5).worlds == 5 and stage._plan(stage.Params(worlds=6), 5).worlds == 6
