"""Compare PPO with that of stable-baselines3 on Pendulum-v1 with equal settings; writes benchmarks/ppo.md.

    pip install stable-baselines3 && PYTHONPATH=. python benchmarks/bench_ppo.py

Both use normalised observations, rewards times 0.01, an initial standard deviation of 1, and equal networks, batches and rates.
They run in turn on one thread; times are CPU seconds. Pendulum ends only by its time limit, from which both bootstrap.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import gymnasium
import numpy as np
import torch
from gymnasium.wrappers import TransformReward

from afford.grasping.env.step_result import StepResult
from afford.grasping.rl.ppo import ActorCritic, PolicyConfig, PPOConfig, make_optimizer, train

TASK, ENVS, STEPS, UPDATES, SEEDS, EPISODES = "Pendulum-v1", 4, 1024, 25, (0, 1, 2), 50
SETTINGS = PPOConfig(updates=UPDATES, steps=STEPS, epochs=10, minibatches=64, lr=1e-3, gamma=0.9, gae_lambda=0.95, clip=0.2,
                     value_weight=0.5, max_grad_norm=0.5, target_kl=0.0, anneal=False)  # fmt: skip
HIDDEN, LIMIT, SCALE = (64, 64), 2.0, 0.01
"""layers; largest torque; rewards are multiplied by it in training"""


@dataclass(frozen=True)
class Row:
    """Result of one training."""

    name: str
    seed: int
    steps_per_s: float
    mean: float


class Pendulums:
    """Environments of afford.grasping.rl.ppo; actions of 1 are the whole torque."""

    def __init__(self, seed: int) -> None:
        mode = {"autoreset_mode": gymnasium.vector.AutoresetMode.SAME_STEP}
        self.envs = gymnasium.make_vec(TASK, ENVS, vectorization_mode="sync", vector_kwargs=mode)
        self.seed = seed

    def reset(self) -> np.ndarray:
        """First observations."""
        return self.envs.reset(seed=self.seed)[0]

    def step(self, action: np.ndarray) -> StepResult:
        """Step all environments."""
        obs, reward, terminated, truncated, infos = self.envs.step((LIMIT * action).clip(-LIMIT, LIMIT))
        final_obs = obs.copy()
        for k in np.flatnonzero(terminated | truncated):
            final_obs[k] = infos["final_obs"][k]
        return StepResult((SCALE * reward).astype(np.float32), terminated, truncated, obs=obs, final_obs=final_obs)


def main() -> None:
    """Train both on every seed, one after another, then write."""
    torch.set_num_threads(1)
    rows = [train(seed) for seed in SEEDS for train in (ours, theirs)]
    lines = ["# PPO", "", "Written by `benchmarks/bench_ppo.py`.", "",
             f"{TASK}, {ENVS * STEPS * UPDATES} steps, {len(SEEDS)} seeds; return is the mean of {EPISODES} episodes.", "",
             "| | steps / CPU s | return, seed by seed | mean |", "|---|--:|---|--:|"]  # fmt: skip
    for name in ("afford", "stable-baselines3"):
        mine = [row for row in rows if row.name == name]
        speed, returns = np.mean([row.steps_per_s for row in mine]), [row.mean for row in mine]
        lines.append(f"| {name} | {speed:.0f} | {', '.join(f'{one:.0f}' for one in returns)} | {np.mean(returns):.0f} |")
    speeds = [np.mean([row.steps_per_s for row in rows if row.name == name]) for name in ("afford", "stable-baselines3")]
    lines += ["", f"afford takes {speeds[1] / speeds[0]:.2f} of the other's time a step.", ""]
    Path(__file__).with_name("ppo.md").write_text("\n".join(lines))


def ours(seed: int) -> Row:
    """Train with afford/grasping/rl/ppo.py."""
    torch.manual_seed(seed)
    model = ActorCritic(PolicyConfig(3, 1, HIDDEN, "tanh", 1.0))
    spent = _timed(lambda: train(Pendulums(seed), model, SETTINGS, make_optimizer(model, SETTINGS.lr), 0, lambda _, __: None))
    model.eval()

    def act(seen: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            return LIMIT * model.actions(torch.from_numpy(seen[None])).mean.numpy()[0]

    return Row("afford", seed, ENVS * STEPS * UPDATES / spent, _return(act))


def theirs(seed: int) -> Row:
    """Train with stable-baselines3."""
    from stable_baselines3 import PPO
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.vec_env import VecNormalize

    scaled = partial(TransformReward, func=lambda reward: SCALE * float(reward))
    envs = VecNormalize(make_vec_env(TASK, ENVS, seed=seed, wrapper_class=scaled), norm_obs=True, norm_reward=False, clip_obs=5.0)
    model = PPO("MlpPolicy", envs, learning_rate=SETTINGS.lr, n_steps=STEPS, batch_size=ENVS * STEPS // SETTINGS.minibatches,
                n_epochs=SETTINGS.epochs, gamma=SETTINGS.gamma, gae_lambda=SETTINGS.lam,
                clip_range=SETTINGS.clip, max_grad_norm=SETTINGS.max_grad_norm, seed=seed, device="cpu",
                policy_kwargs={"net_arch": list(HIDDEN)})  # fmt: skip
    spent = _timed(lambda: model.learn(ENVS * STEPS * UPDATES))

    def act(seen: np.ndarray) -> np.ndarray:
        return np.asarray(model.predict(envs.normalize_obs(seen[None]), deterministic=True)[0][0])

    return Row("stable-baselines3", seed, ENVS * STEPS * UPDATES / spent, _return(act))


def _timed(work: Callable[[], object]) -> float:
    before = time.process_time()
    work()
    return time.process_time() - before


def _return(act: Callable[[np.ndarray], np.ndarray]) -> float:
    env, total = gymnasium.make(TASK), 0.0
    for seed in range(1000, 1000 + EPISODES):
        seen, _ = env.reset(seed=seed)
        over = False
        while not over:
            seen, reward, terminated, truncated, _ = env.step(act(seen))
            total, over = total + float(reward), terminated or truncated
    return total / EPISODES


if __name__ == "__main__":
    main()
