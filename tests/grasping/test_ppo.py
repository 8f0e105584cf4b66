"""PPO: GAE against its definition, RunningMeanStd, the bounds of an update, and learning."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
import torch

from afford.grasping.env.step_result import StepResult
from afford.grasping.rl import ppo
from afford.grasping.rl.ppo import ActorCritic, PolicyConfig, RunningMeanStd, gae, paper_config


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """Compute small networks in one thread, which is faster on busy cores."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


class Reach:
    """A point on a line is pushed towards a goal that stands in the observation; every third step of an environment ends it."""

    def __init__(self, n: int, seed: int) -> None:
        self._n, self._rng, self._goal, self._step = n, np.random.default_rng(seed), np.zeros(n), 0

    def reset(self) -> np.ndarray:
        self._goal = self._rng.uniform(-1, 1, self._n)
        return self._seen()

    def step(self, action: np.ndarray) -> StepResult:
        reward = -((action[:, 0] - self._goal) ** 2)
        reached = self._seen()
        self._step += 1
        ended = np.full(self._n, self._step % 3 == 0)
        no, metrics = np.zeros(self._n, bool), {"reward": float(reward.mean())}
        return StepResult(reward, no, ended, obs=self.reset(), final_obs=reached, metrics=metrics)

    def _seen(self) -> np.ndarray:
        return np.stack([self._goal, np.full(self._n, 40.0)], 1).astype(np.float32)


def model(seed: int = 0) -> ActorCritic:
    torch.manual_seed(seed)
    return ActorCritic(PolicyConfig(2, 1, (32,)))


def trained(updates: int, seed: int = 0) -> tuple[ActorCritic, list[dict[str, float]]]:
    net, config, notes = model(seed), ppo.PPOConfig(updates=updates, steps=8, lr=5e-3), list[dict[str, float]]()
    ppo.train(Reach(32, seed), net, config, ppo.make_optimizer(net, config.lr), 0, lambda _, scalars: notes.append(scalars))
    return net, notes


@pytest.mark.parametrize("seed", range(5))
def test_gae_equals_its_definition(seed: int) -> None:
    """Compare with a plain loop over the sum of (gamma lambda)^k TD errors within an episode."""
    rng = np.random.default_rng(seed)
    reward, value, after = rng.normal(size=(3, 9, 4))
    terminated = rng.random((9, 4)) < 0.2
    ended = terminated | (rng.random((9, 4)) < 0.2)
    gamma, lam = 0.9, 0.8
    expected = np.zeros((9, 4))
    for env in range(4):
        for step in range(9):
            weight = 1.0
            for k in range(step, 9):
                follows = 0.0 if terminated[k, env] else after[k, env]
                expected[step, env] += weight * (reward[k, env] + gamma * follows - value[k, env])
                weight *= gamma * lam
                if ended[k, env]:
                    break
    found = gae(*map(torch.from_numpy, (reward, value, after, terminated, ended)), gamma, lam)
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_gae_bootstraps_after_a_time_limit_only() -> None:
    """One step of value 0 and reward 1, followed by a value of 10: terminated, then truncated."""
    one, yes = torch.ones(1, 1), torch.ones(1, 1, dtype=torch.bool)
    told = [float(gae(one, 0 * one, 10 * one, end, yes, 0.5, 1.0)) for end in (yes, ~yes)]
    assert told == [1.0, 6.0]


def test_ppo_learns_to_reach() -> None:
    """The reward rises from that of random actions to near the best; actions are near the goal."""
    net, notes = trained(60)
    assert notes[0]["reward"] < -0.4 and notes[-1]["reward"] > -0.05
    goals = torch.tensor([[-0.8, 40.0], [0.0, 40.0], [0.7, 40.0]])
    assert (net.actions(goals).mean[:, 0] - goals[:, 0]).abs().max() < 0.2


def test_same_seed_same_weights() -> None:
    """Equal bit for bit; another seed gives other weights."""
    first, again, other = (trained(3, seed)[0].state_dict() for seed in (1, 1, 2))
    assert all(torch.equal(first[name], again[name]) for name in first)
    assert not torch.equal(first["actor.0.weight"], other["actor.0.weight"])


def test_first_probability_ratio_is_one() -> None:
    """KL divergence of 0 before an update, and the entropy of the Gaussian."""
    net, config = model(), ppo.PPOConfig(steps=4)
    envs = Reach(8, 0)
    rollout, _ = ppo.collect_rollout(envs, net, envs.reset(), config)
    _, _, scalars = ppo.losses(net, rollout, torch.arange(len(rollout.action)), config)
    assert abs(scalars["kl"]) < 1e-6
    assert scalars["entropy"] == pytest.approx(0.5 * np.log(2 * np.pi * np.e * net.config.std**2), abs=1e-4)


def test_target_kl_stops_the_policy_but_not_the_critic() -> None:
    """Tiny bound: only the first step changes the policy, and the critic continues; without a bound all passes change it."""
    for bound, expected in ((1e-9, 0.0), (0.0, 5.0)):
        net, config = model(), ppo.PPOConfig(steps=4, target_kl=bound, epochs=5, lr=0.05)
        envs, before = Reach(8, 0), model()
        rollout, _ = ppo.collect_rollout(envs, net, envs.reset(), config)
        assert ppo.update(net, ppo.make_optimizer(net, config.lr), rollout, config)["epochs"] == expected
        actor, critic = (max(float((now - then).detach().abs().max()) for now, then in zip(part(net), part(before), strict=True))
                         for part in (lambda m: m.actor.parameters(), lambda m: m.critic.parameters()))  # fmt: skip
        assert actor <= 0.051 if bound else actor > 0.1
        assert critic > 0.1


@pytest.mark.parametrize("sizes", [(5, 40), (1, 1, 3), (7,)])
def test_running_mean_std_equals_that_of_all_rows(sizes: tuple[int, ...]) -> None:
    """The result does not depend on the sizes of the batches."""
    parts = [torch.randn(n, 3, generator=torch.Generator().manual_seed(n)) * 4 + 2 for n in sizes]
    running = RunningMeanStd(3)
    for part in parts:
        running.update(part)
    rows = torch.cat(parts).double()
    torch.testing.assert_close(running.mean, rows.mean(0))
    torch.testing.assert_close(running.var, rows.var(0, unbiased=False))


def test_paper_config_of_the_networks() -> None:
    """1024-1024-512-512 with ELU, standard deviation 0.8, first actions near zero (AffordDex)."""
    net = ActorCritic(paper_config(300, 24))
    assert [layer.out_features for layer in net.actor if isinstance(layer, torch.nn.Linear)] == [1024, 1024, 512, 512, 24]
    chosen = net.actions(torch.randn(16, 300))
    assert chosen.mean.abs().max() < 0.2 and torch.allclose(chosen.stddev, torch.tensor(0.8))
