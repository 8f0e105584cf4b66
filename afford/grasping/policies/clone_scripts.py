"""Clone scripts of grasps into a network by DAgger, and keep its best weights.

The network starts from the teacher's weights and learns whole actions: the frozen prior, which pulls the hand to the posture of
tools with as much as a residual may add, is left out. It is evaluated on episodes of the training between rounds. The best weights
are those with which the better of network and teacher, task by task, scores most.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from afford.grasping.env.placed_worlds import PlacedWorlds
from afford.grasping.env.rollout import Actor
from afford.grasping.policies.grasp_search import scripts
from afford.grasping.policies.grasp_trials import acting, begin, trial_figures
from afford.grasping.policies.load_policy import MeanAction, Policy, prior_columns
from afford.grasping.rl.ppo import ActorCritic, make_optimizer
from afford.training.loop import derive_seed
from afford.training.state import TrainingState, load_checkpoint, restore_weights, resume, save_checkpoint

MARGIN = 0.05
"""a script, and then the network, takes a task if its score exceeds the teacher's by this"""
VALIDATE_EVERY = 2
"""rounds between two evaluations, and checkpoints"""
VALIDATED, LEARNED = 2, 3
"""first number of the seeds of episodes, by purpose; adapt_teacher.py has others"""


@dataclass(frozen=True)
class CloningConfig:
    """Hyperparameters of the cloning, as in stages/grasping/body_adapt.py."""

    seed: int
    rounds: int
    updates: int
    batch: int
    lr: float
    noise: float


class Cloning:
    """Network that learns the scripts `rows` (t, 17) of t tasks, in worlds of several engines; world k has task k % t."""

    def __init__(self, policy: Policy, teacher: ActorCritic, config: CloningConfig, places: Sequence[PlacedWorlds],
                 rows: np.ndarray) -> None:  # fmt: skip
        self.policy, self.config, self.places, self.rows = policy, config, places, rows
        self.model = ActorCritic(teacher.config)
        self.model.load_state_dict(teacher.state_dict())

    def learn(self, folder: Path, progress: Callable[[int], None]) -> TrainingState:
        """Learn in some rounds, from the last checkpoint in `folder`; the model gets the best weights."""
        config, optimizer = self.config, make_optimizer(self.model, self.config.lr)
        state = resume(folder, self.model, optimizer, "cpu")
        memory = _load_memory(folder, state.step)
        if not state.points:
            self._validate(state, self.policy.actor)
        while state.step < config.rounds:
            seed = derive_seed(config.seed, LEARNED, state.step)
            torch.manual_seed(seed)
            rows = [self._collect(worlds, state.step, [seed, k]) for k, worlds in enumerate(self.places)]
            memory = _joined([memory, *rows] if memory else rows)
            loss = self._fit(memory, optimizer, config.lr * (1 - 0.9 * state.step / config.rounds))
            state.step += 1
            state.log("train", {"loss": loss})
            if state.step % VALIDATE_EVERY == 0 or state.step == config.rounds:
                self._validate(state, self._student)
                _save(folder, state, self.model, optimizer, memory)
            progress(state.step)
        restore_weights(self.model, state.best)
        self.model.eval()
        return state

    def better(self, state: TrainingState) -> np.ndarray:
        """(t,) bool, tasks in which the best weights score more than the teacher."""
        found: np.ndarray = self._scores_at(state, state.best_step) > self._scores_at(state, 0) + MARGIN
        return found

    def _student(self, worlds: PlacedWorlds) -> MeanAction:
        return MeanAction(self.model, None, prior_columns(worlds.config.layout, worlds.config.role))

    def _scores_at(self, state: TrainingState, step: int) -> np.ndarray:
        """(t,) scores of each task in the evaluation at a step."""
        known = {point.name: point.value for point in state.points if point.step == step}
        return np.array([known[f"val.score.{task}"] for task in range(len(self.rows))])

    def _validate(self, state: TrainingState, actor: Callable[[PlacedWorlds], Actor]) -> None:
        """Log the scores of an actor by task."""
        found = trial_figures(self.places, len(self.rows), acting(actor), [self.config.seed, VALIDATED])
        state.log("val", {name: float(figure.mean()) for name, figure in found.items()})
        state.log("val", {f"score.{task}": float(one) for task, one in enumerate(found["score"])})
        better = np.maximum(found["score"], self._scores_at(state, 0) + MARGIN)
        state.update_best(float(better.mean()), self.model, 0)

    @torch.no_grad()
    def _collect(self, worlds: PlacedWorlds, number: int, seed: Sequence[int]) -> tuple[Tensor, Tensor]:
        """Observations (t n, d) and actions (t n, m) to clone of one episode of every world.

        The script acts in the first round and in half of the worlds of the second, then the network; all with noise.
        """
        rngs, tasks = begin(worlds, seed), len(self.rows)
        which, student = np.arange(len(rngs)), self._student(worlds)
        targets = scripts(worlds, self.rows[which % tasks])
        leads = which // tasks % 2 < (2, 1)[number] if number < 2 else np.zeros(len(rngs), bool)
        rows = list[tuple[np.ndarray, np.ndarray]]()
        for step in range(worlds.config.steps):
            wanted = worlds.towards(targets[:, step])
            rows.append((worlds.observe(), wanted.astype(np.float32)))
            chosen = np.where(leads[:, None], wanted, student.act(worlds))
            worlds.step(chosen + self.config.noise * np.stack([rng.normal(size=wanted.shape[1]) for rng in rngs]), rngs)
        obs, label = (torch.from_numpy(np.concatenate(column)) for column in zip(*rows, strict=True))
        return obs, label

    def _fit(self, memory: tuple[Tensor, ...], optimizer: torch.optim.Optimizer, lr: float) -> float:
        """Fit all rows so far in some minibatches; the mean loss."""
        for group in optimizer.param_groups:
            group["lr"] = lr
        self.model.train()
        losses = list[float]()
        for _ in range(self.config.updates):
            rows = torch.randint(len(memory[0]), (self.config.batch,))
            loss = nn.functional.mse_loss(self.model.actions(memory[0][rows]).mean, memory[1][rows])
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(self.model.parameters(), 1.0)
            optimizer.step()
            losses.append(loss.item())
        self.model.eval()
        return float(np.mean(losses))


def _save(folder: Path, state: TrainingState, model: ActorCritic, optimizer: torch.optim.Optimizer,
          memory: tuple[Tensor, ...]) -> None:  # fmt: skip
    """Write the memory under the number of the round, then the checkpoint, then remove older memories."""
    save_checkpoint(_memory_file(folder, state.step), {"obs": memory[0], "label": memory[1]}, {})
    state.save(folder, model, optimizer)
    for old in folder.glob("memory-*.safetensors"):
        if old != _memory_file(folder, state.step):
            old.unlink()


def _load_memory(folder: Path, step: int) -> tuple[Tensor, ...]:
    if not step:
        return ()
    tensors, _ = load_checkpoint(_memory_file(folder, step))
    return tensors["obs"], tensors["label"]


def _joined(rows: Sequence[tuple[Tensor, ...]]) -> tuple[Tensor, ...]:
    return tuple(torch.cat(column) for column in zip(*rows, strict=True))


def _memory_file(folder: Path, step: int) -> Path:
    return folder / f"memory-{step}.safetensors"
