"""The loop: steps, validations, the best weights. It knows no hands, no images and no words.

Killed at any moment and started again with the same task, plan and folder, it ends with the same weights, to the bit: batches
are a function of their number, the random state of every step is set from (seed, step), everything else is in the checkpoint.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import torch
from blake3 import blake3
from torch import Tensor, nn

from afford.training import checkpoint, events
from afford.training.ahead import ahead
from afford.training.gradients import one_by_one, together
from afford.training.precision import mixed
from afford.training.ranks import ALONE, Ranks
from afford.training.schedule import warmup_decay
from afford.training.state import State, resume
from afford.training.task import Batch, Plan, Progress, Task

SAVE_EVERY = 100
"""steps between two checkpoints, beside those at validations"""


def train(task: Task[Batch], plan: Plan, folder: Path, progress: Progress, ranks: Ranks = ALONE) -> State:
    """Train `task.model` and leave its best weights in it, in the first process (the last ones without validation).

    `folder` keeps checkpoint.safetensors, tensorboard/ and previews/, which may be watched while it goes on.
    """
    task.model.to(plan.device)
    optimiser = optimiser_of(task.model, plan)
    state = resume(folder, task.model, optimiser, plan.device)
    model = ranks.wrap(task.model)
    for step, batches in _batches(task, plan, state, ranks):
        scalars = _step(task, model, batches, optimiser, plan, ranks, step)
        state.step = step + 1
        _keep(task, state, scalars, optimiser, plan, folder, ranks)
        progress(state.step, plan.steps)
        if ranks.agree(state.stopped):
            break
    if state.best:
        checkpoint.restore(task.model, state.best)
    else:
        state.best_step = state.step
    return state


def optimiser_of(model: nn.Module, plan: Plan) -> torch.optim.AdamW:
    """AdamW over what may be trained."""
    trainable = [parameter for parameter in model.parameters() if parameter.requires_grad]
    return torch.optim.AdamW(trainable, plan.lr, betas=plan.betas, weight_decay=plan.weight_decay, fused=True)


def _batches(task: Task[Batch], plan: Plan, state: State, ranks: Ranks) -> Iterator[tuple[int, list[Batch]]]:
    """(step, its micro-batches of this process) for every step that is left."""
    steps = range(plan.steps if state.stopped else state.step, plan.steps)
    numbers = ((step * plan.accumulate + part) * ranks.count + ranks.rank for step in steps for part in range(plan.accumulate))
    made = ahead(task.batch, numbers, plan.workers)
    for step in steps:
        yield step, [next(made) for _ in range(plan.accumulate)]


def _step(task: Task[Batch], model: nn.Module, batches: list[Batch], optimiser: torch.optim.Optimizer, plan: Plan,
          ranks: Ranks, step: int) -> dict[str, Tensor]:
    """One step of the optimiser; returns the scalars of its losses, averaged over the micro-batches."""
    torch.manual_seed(seed_of(plan.seed, step, ranks.rank))
    model.train()
    optimiser.zero_grad(set_to_none=True)

    def loss(batch: Batch) -> Mapping[str, Tensor]:
        with mixed(plan.device, plan.bf16):
            return task.loss(model, batch)

    found = together(loss, batches, model, plan.parallel) if plan.parallel > 1 else one_by_one(loss, batches, model, ranks)
    mean = {name: torch.stack([each[name].detach() for each in found]).mean() for name in found[0]}
    lr = plan.lr * warmup_decay(step, plan.warmup, plan.steps, plan.decay)
    for group in optimiser.param_groups:
        group["lr"] = lr
    mean["grad_norm"] = nn.utils.clip_grad_norm_(task.model.parameters(), plan.clip_norm or float("inf"))
    optimiser.step()
    return {**mean, "lr": torch.tensor(lr)}


def _keep(task: Task[Batch], state: State, scalars: Mapping[str, Tensor], optimiser: torch.optim.Optimizer, plan: Plan,
          folder: Path, ranks: Ranks) -> None:
    """Note, validate, save: what is due after this step, in the first process."""
    last = state.step == plan.steps
    if not ranks.first:
        return
    if last or state.step % plan.log_every == 0:
        state.note("train", {name: float(value) for name, value in scalars.items()})
    if plan.validate_every and (last or state.step % plan.validate_every == 0):
        _validate(task, state, plan, folder)
    elif state.step % SAVE_EVERY and not last:
        return
    events.write(folder / "tensorboard", state.points)
    state.save(folder, task.model, optimiser)


def _validate(task: Task[Batch], state: State, plan: Plan, folder: Path) -> None:
    task.model.eval()
    with torch.no_grad(), mixed(plan.device, plan.bf16):
        found = task.validate()
        previews = folder / "previews"
        previews.mkdir(parents=True, exist_ok=True)
        task.preview(previews, state.step)
    state.note("val", found)
    state.judge(found[task.judged_by], task.model, plan.patience)


def seed_of(*numbers: int) -> int:
    """63 bits that look random and are a function of these numbers."""
    return int.from_bytes(blake3(repr(numbers).encode()).digest(8), "big") >> 1
