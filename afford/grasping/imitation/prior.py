"""Training the prior: first by doing what the expert would do where the policy went (DAgger, Ross et al. 2011), then by PPO for the
rewards of imitation.

An update is one episode of every world, and all that is random in it comes from its number: a training that was killed goes on to
the same weights, to the bit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from afford.grasping.env.vector import Learning, Many, means
from afford.grasping.imitation.rehearse import Rehearsing
from afford.grasping.rl import ppo
from afford.grasping.rl.policy import ActorCritic
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
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Plan:
    """How long, and how."""

    seed: int
    cloning: int
    """updates of the first kind"""
    alone: int
    """from this update on the policy acts; before, more and more often instead of the expert"""
    memory: int
    """episodes of every world that are learned from"""
    passes: int
    """over them in an update"""
    batch: int
    lr: float
    """of Adam in the first kind; it falls to a tenth"""
    nudged: float
    """share of episodes in which somebody moves the hand along the object"""
    noise: float
    """standard deviation of what is added to every action"""
    critic: int
    """updates of the second kind that only the critic learns in"""
    ppo: ppo.Config


@dataclass
class Training:
    """Where it stands."""

    model: ActorCritic
    optimiser: torch.optim.Adam
    seen: Tensor
    """(k, d) observations that are remembered, the oldest first"""
    wanted: Tensor
    """(k, a) what the expert would have done"""
    points: list[Point]
    update: int = 0

    def note(self, prefix: str, scalars: dict[str, float]) -> None:
        """Keep what was measured in this update."""
        self.points += [Point(self.update, f"{prefix}.{name.replace('/', '_')}", float(value)) for name, value in scalars.items()]

    def save(self, folder: Path) -> None:
        """Put the training away."""
        parts = {"now": trained_weights(self.model), "moments": optimizer_state(self.optimiser),
                 "memory": {"seen": self.seen, "wanted": self.wanted}}  # fmt: skip
        tensors = {f"{part}/{name}": tensor for part, found in parts.items() for name, tensor in found.items()}
        save_checkpoint(folder / FILE, tensors, {"update": self.update, "points": self.points})


def train(core: Rehearsing, model: ActorCritic, plan: Plan, folder: Path, progress: Progress) -> list[Point]:
    """Train `model`; the curves."""
    made = _resumed(model, plan, folder)
    total = plan.cloning + plan.ppo.updates
    envs = Learning(Many(core, len(core.grasping.tasks)), 0)
    while made.update < total:
        torch.manual_seed(derive_seed(plan.seed, made.update))
        if made.update < plan.cloning:
            _clone(core, made, plan)
        else:
            _reinforce(envs, made, plan)
        made.update += 1
        if made.update == total or made.update % SAVE_EVERY == 0:
            made.save(folder)
        progress(made.update, total)
    return made.points


def _resumed(model: ActorCritic, plan: Plan, folder: Path) -> Training:
    seen, wanted = torch.zeros(0, model.config.observation), torch.zeros(0, model.config.action)
    made = Training(model, ppo.adam(model, plan.lr), seen, wanted, [])
    if not (folder / FILE).exists():
        return made
    tensors, words = load_checkpoint(folder / FILE)
    parts: dict[str, dict[str, Tensor]] = {"now": {}, "moments": {}, "memory": {}}
    for name, tensor in tensors.items():
        part, _, key = name.partition("/")
        parts[part][key] = tensor
    restore_weights(model, parts["now"])
    restore_optimizer(made.optimiser, parts["moments"])
    made.seen, made.wanted = parts["memory"]["seen"], parts["memory"]["wanted"]
    made.update, made.points = words["update"], [Point(*point) for point in words["points"]]
    return made


def _clone(core: Rehearsing, made: Training, plan: Plan) -> None:
    """One episode of every world, and passes over what is remembered."""
    seen, wanted, notes = _episode(core, made.model, plan, made.update)
    made.model.seen.update(seen)
    keep = plan.memory * len(seen)
    made.seen, made.wanted = torch.cat([made.seen, seen])[-keep:], torch.cat([made.wanted, wanted])[-keep:]
    for group in made.optimiser.param_groups:
        group["lr"] = plan.lr * (1 - 0.9 * made.update / plan.cloning)
    losses = list[float]()
    made.model.train()
    for _ in range(plan.passes):
        for rows in torch.randperm(len(made.seen)).split(plan.batch):
            loss = nn.functional.mse_loss(made.model.actions(made.seen[rows]).mean, made.wanted[rows])
            made.optimiser.zero_grad()
            loss.backward()
            made.optimiser.step()
            losses.append(loss.item())
    made.note("clone", {**notes, "loss": float(np.mean(losses))})


@torch.no_grad()
def _episode(core: Rehearsing, model: ActorCritic, plan: Plan, update: int) -> tuple[Tensor, Tensor, dict[str, float]]:
    """(t n, d) what was seen, (t n, a) what the expert would have done, and the report."""
    n, steps = len(core.grasping.tasks), core.config.steps
    rng = np.random.default_rng([plan.seed, update])
    rngs = [np.random.default_rng([plan.seed, update, k]) for k in range(n)]
    core.reset(range(n), rngs)
    model.eval()
    expert_acts = rng.random(n) < 1 - update / max(plan.alone, 1)
    nudges = _nudges(plan, n, steps, rng)
    rows = list[tuple[Tensor, Tensor]]()
    for step in range(steps):
        seen, expert = torch.from_numpy(core.observe()), core.expert()
        own = model.actions(seen).mean.numpy()
        action = np.where(expert_acts[:, None], expert, own) + plan.noise * rng.normal(size=expert.shape)
        action[:, 0] += nudges[step]
        core.step(action, rngs)
        rows.append((seen, torch.from_numpy(expert.astype(np.float32))))
    seen, wanted = (torch.stack(column).flatten(0, 1) for column in zip(*rows, strict=True))
    return seen, wanted, means(core.report(), ~expert_acts)


def _nudges(plan: Plan, n: int, steps: int, rng: np.random.Generator) -> np.ndarray:
    """(t, n) actions along the object while the hand comes down, as somebody would who wants to grasp elsewhere."""
    first, last = rng.integers(0, 8, n), rng.integers(1, 8, n)
    at = np.arange(steps)[:, None]
    size = rng.uniform(-1, 1, n) * (rng.random(n) < plan.nudged)
    found: np.ndarray = size * ((at >= first) & (at < first + last))
    return found


def _reinforce(envs: Learning, made: Training, plan: Plan) -> None:
    """One rollout of PPO, which is one episode of every world."""
    number = made.update - plan.cloning
    envs.seed = derive_seed(plan.seed, made.update, 1) % 2**31
    actor = (*made.model.actor.parameters(), made.model.log_std)
    for parameter in actor:
        parameter.requires_grad_(number >= plan.critic)
    for group in made.optimiser.param_groups:
        group["lr"] = plan.ppo.lr * (1 - number / plan.ppo.updates)
    rollout, _ = ppo.collect(envs, made.model, envs.reset(), plan.ppo)
    made.note("ppo", rollout.notes | ppo.improve(made.model, made.optimiser, rollout, plan.ppo))
    for parameter in actor:
        parameter.requires_grad_(True)
