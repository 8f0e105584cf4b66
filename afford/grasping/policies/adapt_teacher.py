"""Adapt a trained teacher to the tasks of one body, in minutes: scripted demonstrations that lift it, cloned by DAgger.

The expert of a task is the script that a search found (grasp_search.py), or the teacher as it was, whichever is better in all
engines. Tasks in which the teacher succeeds anyway therefore keep its actions. The network starts from the teacher's weights and
learns whole actions: the frozen prior, which pulls the hand to the posture of tools with as much as a residual may add, is left
out. It is evaluated on episodes of the training between rounds, and the best weights are kept. If none are better than the teacher
with its prior, the policy stays as it was.

Randomness of the search is a function of the seed, that of a round of its number, so that a killed adaptation resumes to the same
weights from its last round.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from afford.common.files import empty_folder
from afford.grasping.env.placed_worlds import PlacedWorlds
from afford.grasping.policies.grasp_search import Limits, scripts, search_grasps
from afford.grasping.policies.load_policy import MeanAction, Policy, prior_columns
from afford.grasping.rl import policy_files
from afford.grasping.rl.ppo import ActorCritic, make_optimizer
from afford.grasping.sim.scene import Physics
from afford.training.loop import derive_seed
from afford.training.state import TrainingState, load_checkpoint, restore_weights, resume, save_checkpoint
from schemas.grasp import GraspTask
from schemas.hand import HandModel

EXPERTS = "experts.safetensors"
FINALISTS = 3
"""best scripts of a search, which are tried in all engines"""
MARGIN = 0.05
"""a script is the expert of a task if its score exceeds the teacher's by this"""
VALIDATE_EVERY = 2
"""rounds between two evaluations, and checkpoints"""
TOUCHING = 0.5
"""share of an episode's score that is lost if all fingertips end at negative points"""
SEARCHED, TRIED, VALIDATED, LEARNED = range(4)
"""first number of the seeds of episodes, by purpose"""


@dataclass(frozen=True)
class AdaptationConfig:
    """Hyperparameters of an adaptation, as in stages/grasping/body_adapt.py."""

    seed: int
    worlds: int
    bullet: int
    generations: int
    trials: int
    sure: int
    rounds: int
    updates: int
    batch: int
    lr: float
    noise: float
    enough: float
    iterations: int
    carry: bool


@dataclass(frozen=True, eq=False)
class Expert:
    """Actions to clone: of a script for some tasks, of the teacher for the others."""

    rows: np.ndarray
    """(t, 17) script of each task"""
    scripted: np.ndarray
    """(t,) bool, the task is that of a script"""

    def mixed(self, worlds: PlacedWorlds, targets: np.ndarray, teacher: np.ndarray) -> np.ndarray:
        """(n, m) actions: towards the targets (n, m) of scripts, or those of the teacher (n, m)."""
        which = self.scripted[np.arange(len(teacher)) % len(self.scripted)]
        return np.where(which[:, None], worlds.towards(targets), teacher)

    def targets(self, worlds: PlacedWorlds) -> np.ndarray:
        """(n, steps, m) targets of the scripts."""
        return scripts(worlds, self.rows[np.arange(len(worlds.tasks)) % len(self.rows)])


def adapt_teacher(hand: HandModel, tasks: Sequence[GraspTask], policy: Policy, config: AdaptationConfig, folder: Path,
                  progress: Callable[[int, int], None]) -> tuple[ActorCritic, TrainingState]:  # fmt: skip
    """Adapt the teacher of a policy; the network with the best weights, and its curves. `best_step` is 0 where none were better.

    ValueError for a policy without a teacher, or over the scripted base, whose targets move by themselves.
    """
    if policy.teacher is None or policy.facts["base"] == "script":
        raise ValueError("body_adapt: expected a teacher with base=prior or none, got another policy; give the files of "
                         "rl_grasp_refinement")
    total = config.generations + config.rounds
    places = _worlds(hand, tasks, policy, config)
    try:
        adaptation = Adaptation(policy, policy.teacher, config, places, len(tasks))
        expert = _experts(adaptation, folder, lambda done: progress(done, total))
        return adaptation.learn(expert, folder, lambda done: progress(config.generations + done, total))
    finally:
        for one in places:
            one.close()


def export_adapted(folder: Path, model: ActorCritic, policy: Policy) -> Path:
    """Write the adapted teacher, which has no prior, with the facts of its environment into folder/out."""
    root = empty_folder(folder / "out")
    policy_files.write_policy(root, model, policy.facts)
    return root


class Adaptation:
    """The worlds of an adaptation in all engines, its frozen teacher, and the network that learns."""

    def __init__(self, policy: Policy, teacher: ActorCritic, config: AdaptationConfig, places: Sequence[PlacedWorlds],
                 tasks: int) -> None:  # fmt: skip
        self.config, self.places, self.tasks = config, places, tasks
        self.model = ActorCritic(teacher.config)
        self.model.load_state_dict(teacher.state_dict())
        columns = prior_columns(places[0].config.layout, places[0].config.role)
        self.teacher, self.student = MeanAction(teacher, policy.prior, columns), MeanAction(self.model, None, columns)

    def scores(self, choose: Callable[[PlacedWorlds], Callable[[int], np.ndarray]], seed: Sequence[int]) -> dict[str, np.ndarray]:
        """(t,) mean figures of each task over an episode of every world, engines weighing alike.

        `choose(worlds)` begins an episode, and returns a function from step to actions (n, m).
        """
        found = [self._figures(worlds, choose, [*seed, k]) for k, worlds in enumerate(self.places)]
        return {name: np.mean([one[name] for one in found], axis=0) for name in found[0]}

    def _figures(self, worlds: PlacedWorlds, choose: Callable[[PlacedWorlds], Callable[[int], np.ndarray]],
                 seed: Sequence[int]) -> dict[str, np.ndarray]:  # fmt: skip
        rngs = _begin(worlds, seed)
        act = choose(worlds)
        for step in range(worlds.config.steps):
            worlds.step(act(step), rngs)
        report = worlds.report()
        report["score"] = episode_scores(report)
        return {name: report[name].reshape(-1, self.tasks).mean(0) for name in ("score", "success", "held", "as_violation_pct")}

    def search(self, wanted: Sequence[int], progress: Callable[[int], None]) -> np.ndarray:
        """(w, finalists, 17) best scripts of the tasks `wanted`, in worlds of these tasks alone."""
        config = self.config
        limits = Limits(config.generations, config.trials, config.sure)
        places = [PlacedWorlds(one.scenery.hand, [one.given[k] for k in wanted] * (len(one.tasks) // self.tasks), one.config,
                               one.carry) for one in self.places]  # fmt: skip
        try:
            return search_grasps(places, len(wanted), limits, FINALISTS, config.noise, derive_seed(config.seed, SEARCHED), progress)
        finally:
            for one in places:
                one.close()

    def learn(self, expert: Expert, folder: Path, progress: Callable[[int], None]) -> tuple[ActorCritic, TrainingState]:
        """Clone the expert by DAgger; the network with the best weights."""
        config, optimizer = self.config, make_optimizer(self.model, self.config.lr)
        state = resume(folder, self.model, optimizer, "cpu")
        memory = _load_memory(folder, state.step)
        if not state.points:
            self._validate(state, self.teacher)
        while state.step < config.rounds and expert.scripted.any():
            seed = derive_seed(config.seed, LEARNED, state.step)
            torch.manual_seed(seed)
            rows = [self._collect(worlds, expert, state.step, [seed, k]) for k, worlds in enumerate(self.places)]
            memory = _joined([memory, *rows] if memory else rows)
            loss = self._fit(memory, optimizer, config.lr * (1 - 0.9 * state.step / config.rounds))
            state.step += 1
            state.log("train", {"loss": loss})
            if state.step % VALIDATE_EVERY == 0 or state.step == config.rounds:
                self._validate(state, self.student)
                _save(folder, state, self.model, optimizer, memory)
            progress(state.step)
        restore_weights(self.model, state.best)
        return self.model.eval(), state

    def _validate(self, state: TrainingState, actor: MeanAction) -> None:
        found = self.scores(lambda worlds: lambda step: actor.act(worlds), [self.config.seed, VALIDATED])
        state.log("val", {name: float(figure.mean()) for name, figure in found.items()})
        state.update_best(float(found["score"].mean()), self.model, 0)

    @torch.no_grad()
    def _collect(self, worlds: PlacedWorlds, expert: Expert, number: int, seed: Sequence[int]) -> tuple[Tensor, Tensor]:
        """Observations (t n, d) and actions (t n, m) to clone of one episode of every world.

        The expert acts in the first round and in half of the worlds of the second, then the network; all with noise.
        """
        rngs, targets = _begin(worlds, seed), expert.targets(worlds)
        leads = np.arange(len(rngs)) // self.tasks % 2 < (2, 1)[number] if number < 2 else np.zeros(len(rngs), bool)
        rows = list[tuple[np.ndarray, np.ndarray]]()
        for step in range(worlds.config.steps):
            wanted = expert.mixed(worlds, targets[:, step], self.teacher.act(worlds))
            rows.append((worlds.observe(), wanted.astype(np.float32)))
            chosen = np.where(leads[:, None], wanted, self.student.act(worlds))
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


def episode_scores(report: dict[str, np.ndarray]) -> np.ndarray:
    """(n,) scores of episodes: the mean of success and held, less for fingertips that end at negative points."""
    out: np.ndarray = (report["success"] + report["held"]) / 2 * (1 - TOUCHING * report["as_violation_pct"] / 100)
    return out


def _experts(adaptation: Adaptation, folder: Path, progress: Callable[[int], None]) -> Expert:
    """Choose the expert of each task: the best script of a search, where it is better than the teacher."""
    if (folder / EXPERTS).exists():
        tensors, _ = load_checkpoint(folder / EXPERTS)
        return Expert(tensors["rows"].numpy(), tensors["scripted"].numpy())
    config, tasks = adaptation.config, adaptation.tasks
    seed = [config.seed, TRIED]
    teacher = adaptation.scores(lambda worlds: lambda step: adaptation.teacher.act(worlds), seed)["score"]
    wanted = np.flatnonzero(teacher < config.enough).tolist()
    best, score = np.zeros((tasks, 17)), teacher + MARGIN
    found = np.tile(best[:, None], (1, FINALISTS, 1))
    if wanted:
        found[wanted] = adaptation.search(wanted, progress)
    for number in range(FINALISTS if wanted else 0):
        rows = found[:, number]
        tried = adaptation.scores(lambda worlds, rows=rows: _follow(worlds, rows, tasks), seed)["score"]  # type: ignore[misc]
        better = (tried > score) & np.isin(np.arange(tasks), wanted)
        best[better], score[better] = rows[better], tried[better]
    expert = Expert(best, np.asarray(best.any(axis=1)))
    save_checkpoint(folder / EXPERTS, {"rows": torch.from_numpy(best), "scripted": torch.from_numpy(expert.scripted)}, {})
    return expert


def _follow(worlds: PlacedWorlds, rows: np.ndarray, tasks: int) -> Callable[[int], np.ndarray]:
    """Actions of the scripts (t, 17) of all tasks, for the episodes that have just begun."""
    targets = scripts(worlds, rows[np.arange(len(worlds.tasks)) % tasks])
    return lambda step: worlds.towards(targets[:, step])


def _begin(worlds: PlacedWorlds, seed: Sequence[int]) -> list[np.random.Generator]:
    """Reset all worlds; their generators."""
    rngs = [np.random.default_rng([*seed, k]) for k in range(len(worlds.tasks))]
    worlds.reset(range(len(rngs)), rngs)
    return rngs


def _worlds(hand: HandModel, tasks: Sequence[GraspTask], policy: Policy, config: AdaptationConfig) -> list[PlacedWorlds]:
    """Worlds in MuJoCo, for the search, and fewer in PyBullet."""
    physics = Physics(iterations=config.iterations)
    count = {"mujoco": config.worlds, "bullet": config.bullet}
    return [PlacedWorlds(hand, [*tasks] * each, policy.config(engine, physics, "flat", 0.0), config.carry)
            for engine, each in count.items() if each]  # fmt: skip


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
