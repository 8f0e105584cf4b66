"""Train the prior by DAgger (Ross et al. 2011) from an expert that follows reference clips, then by PPO for imitation rewards.

PPO begins with a critic alone, which is fitted by plain regression until it explains enough of the variance of returns: the clipped
value loss of PPO moves values by 0.2 an update, far less than returns are. The reward does not see the object, so that PPO alone
loosens grasps; the policy stays anchored to the expert's actions (compare DAPG, Rajeswaran et al. 2018).
An update plays one episode in every world, and all randomness in it is a function of its number. A training that was killed
therefore resumes to the same weights, bit for bit.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from afford.common.arrays import like, namespace, single
from afford.grasping.env.flight_recorder import FlightRecorder
from afford.grasping.env.gym_env import PPOEnvAdapter, VectorEnv, mean_report
from afford.grasping.env.step_result import StepResult
from afford.grasping.imitation.grasp_imitation_env import GraspImitationWorlds
from afford.grasping.rl import policy_files, ppo
from afford.grasping.rl.ppo import ActorCritic, PolicyConfig
from afford.training.curves import Point
from afford.training.loop import derive_seed
from afford.training.state import (
    load_checkpoint,
    optimizer_state,
    restore_optimizer,
    restore_weights,
    save_checkpoint,
    trained_weights,
)

FILE = "checkpoint.safetensors"
SAVE_EVERY = 20
"""updates between two checkpoints"""
CRITIC_LR, CRITIC_PASSES = 1e-3, 20
"""learning rate and passes over a rollout while only the critic learns"""
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class PriorTrainingConfig:
    """Hyperparameters of the prior's training."""

    seed: int
    cloning: int
    """updates of DAgger"""
    alone: int
    """update from which the policy acts in all worlds; before, the expert acts in a falling share of them"""
    memory: int
    """episodes of every world in the replay buffer"""
    passes: int
    """passes over the buffer in an update"""
    batch: int
    """rows of a minibatch"""
    lr: float
    """learning rate of Adam in DAgger; it falls to a tenth"""
    nudged: float
    """share of episodes in which the hand is moved along the object on its way down"""
    noise: float
    """standard deviation of the noise that is added to actions"""
    critic: int
    """first updates of PPO, at most, in which only the critic learns"""
    settled: float
    """explained variance of returns from which the critic has settled and the policy learns"""
    anchor: float
    """weight of the squared difference from the expert's actions in PPO"""
    std: float
    """standard deviation of actions in PPO"""
    ppo: ppo.PPOConfig


@dataclass
class PriorTraining:
    """State of a training, which a checkpoint keeps."""

    model: ActorCritic
    optimizer: torch.optim.Adam
    obs: Tensor
    """(k, d) observations in the replay buffer, oldest first"""
    label: Tensor
    """(k, a) actions of the expert"""
    points: list[Point]
    update: int = 0
    settled: bool = False
    """whether the critic has settled"""

    def log(self, prefix: str, scalars: dict[str, float]) -> None:
        """Append scalars of this update to the curves."""
        self.points += [Point(self.update, f"{prefix}.{name.replace('/', '_')}", float(value)) for name, value in scalars.items()]

    def save(self, folder: Path) -> None:
        """Write a checkpoint."""
        parts = {"now": trained_weights(self.model), "moments": optimizer_state(self.optimizer),
                 "memory": {"obs": self.obs, "label": self.label}}  # fmt: skip
        tensors = {f"{part}/{name}": tensor for part, found in parts.items() for name, tensor in found.items()}
        save_checkpoint(folder / FILE, tensors, {"update": self.update, "points": self.points, "settled": self.settled})


def new_prior(core: GraspImitationWorlds, hidden: tuple[int, ...], std: float, seed: int) -> ActorCritic:
    """Create an untrained prior; its weights are a function of the seed."""
    torch.manual_seed(derive_seed(seed))
    return ActorCritic(PolicyConfig(core.width, core.motors, hidden, std=std))


def train_prior(core: GraspImitationWorlds, model: ActorCritic, config: PriorTrainingConfig, folder: Path,
                progress: Progress, recorder: FlightRecorder | None = None) -> list[Point]:  # fmt: skip
    """Train `model` in place, on its device; its curves. `folder` holds the checkpoint, `recorder` is that of the worlds."""
    state = _resume(model, config, folder)
    total = config.cloning + config.ppo.updates
    envs = LabellingEnv(core)
    while state.update < total:
        torch.manual_seed(derive_seed(config.seed, state.update))
        if recorder is not None:
            recorder.begin(state.update)
        if state.update < config.cloning:
            _dagger_update(core, state, config)
        else:
            _ppo_update(envs, state, config)
        if recorder is not None:
            state.log("train", recorder.take_count())
        state.update += 1
        if state.update == total or state.update % SAVE_EVERY == 0:
            state.save(folder)
        progress(state.update, total)
    return state.points


def export_prior(root: Path, model: ActorCritic, facts: Mapping[str, Any]) -> Path:
    """Write the prior and its facts into the new folder `root`."""
    shutil.rmtree(root, ignore_errors=True)
    policy_files.write_policy(root, model, facts)
    return root


def _resume(model: ActorCritic, config: PriorTrainingConfig, folder: Path) -> PriorTraining:
    obs, label = (torch.zeros(0, width, device=model.device) for width in (model.config.observation, model.config.action))
    state = PriorTraining(model, ppo.make_optimizer(model, config.lr), obs, label, [])
    if not (folder / FILE).exists():
        return state
    tensors, words = load_checkpoint(folder / FILE)
    parts: dict[str, dict[str, Tensor]] = {"now": {}, "moments": {}, "memory": {}}
    for name, tensor in tensors.items():
        part, _, key = name.partition("/")
        parts[part][key] = tensor
    restore_weights(model, parts["now"])
    restore_optimizer(state.optimizer, parts["moments"])
    state.obs, state.label = (parts["memory"][name].to(model.device) for name in ("obs", "label"))
    state.update, state.points = words["update"], [Point(*point) for point in words["points"]]
    state.settled = words["settled"]
    return state


def _dagger_update(core: GraspImitationWorlds, state: PriorTraining, config: PriorTrainingConfig) -> None:
    """Play one episode in every world, then fit the expert's actions in several passes over the replay buffer."""
    obs, label, metrics = _collect_episodes(core, state.model, config, state.update)
    state.model.seen.update(obs)
    keep = config.memory * len(obs)
    state.obs, state.label = torch.cat([state.obs, obs])[-keep:], torch.cat([state.label, label])[-keep:]
    for group in state.optimizer.param_groups:
        group["lr"] = config.lr * (1 - 0.9 * state.update / config.cloning)
    losses = list[float]()
    state.model.train()
    for _ in range(config.passes):
        for rows in torch.randperm(len(state.obs)).to(state.obs.device).split(config.batch):
            loss = nn.functional.mse_loss(state.model.actions(state.obs[rows]).mean, state.label[rows])
            state.optimizer.zero_grad()
            loss.backward()
            state.optimizer.step()
            losses.append(loss.item())
    state.log("clone", {**metrics, "loss": float(np.mean(losses))})


@torch.no_grad()
def _collect_episodes(core: GraspImitationWorlds, model: ActorCritic, config: PriorTrainingConfig,
                      update: int) -> tuple[Tensor, Tensor, dict[str, float]]:  # fmt: skip
    """Observations (t n, d), actions of the expert (t n, a), and mean figures of the worlds in which the policy acted."""
    n, steps, own = len(core.grasping.tasks), core.config.steps, core.grasping.arrays.own
    rng = np.random.default_rng([config.seed, update])
    rngs = [np.random.default_rng([config.seed, update, k]) for k in range(n)]
    core.reset(range(n), rngs)
    model.eval()
    expert_acts = rng.random(n) < 1 - update / max(config.alone, 1)
    nudges, noise = own(_nudges(config, n, steps, rng)), own(config.noise * rng.normal(size=(steps, n, core.motors)))
    leads = own(expert_acts[:, None])
    rows = list[tuple[Tensor, Tensor]]()
    for step in range(steps):
        obs, expert = torch.as_tensor(core.observe(), device=model.device), core.expert()
        action = namespace(expert).where(leads, expert, like(model.actions(obs).mean, expert)) + noise[step]
        action[:, 0] += nudges[step]
        core.step(action, rngs)
        rows.append((obs, torch.as_tensor(single(expert), device=model.device)))
    all_obs, label = (torch.stack(column).flatten(0, 1) for column in zip(*rows, strict=True))
    return all_obs, label, mean_report(core.report(), ~expert_acts)


def _nudges(config: PriorTrainingConfig, n: int, steps: int, rng: np.random.Generator) -> np.ndarray:
    """(t, n) actions along the object while the hand descends, as a teacher makes them that wants to grasp elsewhere."""
    first, last = rng.integers(0, 8, n), rng.integers(1, 8, n)
    at = np.arange(steps)[:, None]
    size = rng.uniform(-1, 1, n) * (rng.random(n) < config.nudged)
    found: np.ndarray = size * ((at >= first) & (at < first + last))
    return found


class LabellingEnv(PPOEnvAdapter):
    """Environment of PPO that keeps the expert's action in every state of a rollout."""

    def __init__(self, core: GraspImitationWorlds) -> None:
        super().__init__(VectorEnv(core, len(core.grasping.tasks)), 0)
        self.core, self._labels = core, list[Tensor]()

    def reset(self) -> np.ndarray:
        """First observations (n, d) of a rollout."""
        self._labels.clear()
        return super().reset()

    def step(self, action: np.ndarray) -> StepResult:
        """Apply actions (n, a)."""
        self._labels.append(torch.as_tensor(single(self.core.expert())))
        return super().step(action)

    @property
    def labels(self) -> Tensor:
        """(t n, a) actions of the expert, in the order of the rollout."""
        return torch.stack(self._labels).flatten(0, 1)


def _ppo_update(envs: LabellingEnv, state: PriorTraining, config: PriorTrainingConfig) -> None:
    """Collect one rollout of PPO, which is one episode of every world, and update the critic alone, or both networks."""
    number, model = state.update - config.cloning, state.model
    if number == 0:
        with torch.no_grad():
            model.log_std.fill_(float(np.log(config.std)))
    envs.seed = derive_seed(config.seed, state.update, 1) % 2**31
    rollout, _ = ppo.collect_rollout(envs, model, envs.reset(), config.ppo)
    explained = explained_variance(rollout)
    state.settled = state.settled or explained > config.settled or number >= config.critic
    scalars = rollout.metrics | {"explained_variance": explained, "settled": float(state.settled)}
    for group in state.optimizer.param_groups:
        group["lr"] = config.ppo.lr * (1 - number / config.ppo.updates) if state.settled else CRITIC_LR
    if state.settled:
        scalars |= ppo.update(model, state.optimizer, rollout, config.ppo)
        labels = envs.labels.to(model.device)
        scalars["anchor"] = _fit(state, config.batch, 1, lambda rows: config.anchor * nn.functional.mse_loss(
            model.actions(rollout.obs[rows]).mean, labels[rows]), len(labels))  # fmt: skip
    else:
        scalars["critic"] = _fit(state, config.batch, CRITIC_PASSES, lambda rows: nn.functional.mse_loss(
            model.value(rollout.obs[rows]), rollout.target[rows]), len(rollout.target))  # fmt: skip
    state.log("ppo", scalars)


def _fit(state: PriorTraining, batch: int, passes: int, loss_of: Callable[[Tensor], Tensor], count: int) -> float:
    """Minimize a loss over rows in several passes; the mean loss."""
    losses = list[float]()
    state.model.train()
    for _ in range(passes):
        for rows in torch.randperm(count).to(state.model.device).split(batch):
            loss = loss_of(rows)
            state.optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(state.model.parameters(), 1.0)
            state.optimizer.step()
            losses.append(loss.item())
    return float(np.mean(losses))


def explained_variance(rollout: ppo.Rollout) -> float:
    """Compute the share of the variance of the critic's targets that its values explain: 1 is perfect, 0 that of a constant."""
    return float(1 - (rollout.target - rollout.value).var() / rollout.target.var().clamp(min=1e-12))
