"""Training loop: batches, gradients, learning-rate schedule, validation, checkpoints. It knows no task and no model.

A training that is killed at any moment and started again with the same task, plan and folder ends with the same weights, to the
bit: batch n is a function of n, the random state of every step is seeded from (seed, step), and the rest is in the checkpoint.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import torch
from blake3 import blake3
from torch import Tensor, distributed, nn
from torch.nn.parallel import DistributedDataParallel

from afford.training.curves import EventWriter
from afford.training.job import Batch, Job, Progress, Task
from afford.training.params import Plan
from afford.training.state import TrainingState, restore_weights, resume

SAVE_EVERY = 100
"""steps between two checkpoints; every validation saves one too"""
BFLOAT16_INSTRUCTIONS = ("amx_bf16", "avx512_bf16", "bf16")
"""CPU instructions that multiply bfloat16 (AMX, AVX-512, Arm)"""

Item = TypeVar("Item")
Loss = Callable[[Batch], Mapping[str, Tensor]]
"""a micro-batch -> named scalars, of which `total` is minimised"""
Gradients = tuple[Tensor | None, ...]


@dataclass(frozen=True)
class ProcessGroup:
    """Data-parallel processes that train one model, and the rank of this process among them."""

    rank: int = 0
    count: int = 1

    @property
    def is_main(self) -> bool:
        """True for the process that validates and writes files."""
        return self.rank == 0

    def wrap(self, model: nn.Module) -> nn.Module:
        """Wrap a model so that backward passes average its gradients over all processes."""
        return DistributedDataParallel(model) if self.count > 1 else model

    def no_sync(self, model: nn.Module, last: bool) -> AbstractContextManager[None]:
        """Exchange gradients on the `last` micro-batch of a step only."""
        return model.no_sync() if isinstance(model, DistributedDataParallel) and not last else nullcontext()

    def broadcast(self, stop: bool) -> bool:
        """Return the decision of the main process."""
        if self.count == 1:
            return stop
        decision = [stop]
        distributed.broadcast_object_list(decision, src=0)
        return decision[0]


SINGLE_PROCESS = ProcessGroup()


def fit(job: Job[Batch], scratch: Path, progress: Progress,
        group: ProcessGroup = SINGLE_PROCESS) -> tuple[nn.Module, TrainingState]:  # fmt: skip
    """Train the model of a job, or resume from the checkpoint in `scratch`. `job.prepare` must have run.

    Returns the model, with its best weights and the config that validation chose, and the final state.
    """
    task = job.task(scratch, group.count)
    state = train(task, job.plan, scratch, progress, group)
    job.finish(task.model, state)
    return task.model, state


def train(task: Task[Batch], plan: Plan, folder: Path, progress: Progress, group: ProcessGroup = SINGLE_PROCESS) -> TrainingState:
    """Train `task.model`; its best weights are restored in the main process at the end (the last ones without validation).

    `folder` holds checkpoint.safetensors, tensorboard/ and previews/, which can be watched during training.
    """
    task.model.to(plan.device)
    optimizer = make_optimizer(task.model, plan)
    state = resume(folder, task.model, optimizer, plan.device)
    events = EventWriter(folder / "tensorboard", state.points) if group.is_main else None
    model = group.wrap(task.model)
    for step, batches in _batches(task, plan, state, group):
        torch.manual_seed(derive_seed(plan.seed, step, group.rank))
        scalars = _optimizer_step(task, model, batches, optimizer, plan, group, step)
        state.step = step + 1
        if events is not None:
            last = state.step == plan.steps
            validating = bool(plan.validate_every) and (last or state.step % plan.validate_every == 0)
            if last or state.step % plan.log_every == 0:
                state.log("train", {name: float(value) for name, value in scalars.items()})
            if validating:
                _validate(task, state, plan, folder)
            if validating or last or state.step % SAVE_EVERY == 0:
                events.append(state.points)
                state.save(folder, task.model, optimizer)
        progress(state.step, plan.steps)
        if group.broadcast(state.stopped):
            break
    if state.best:
        restore_weights(task.model, state.best)
    else:
        state.best_step = state.step
    return state


def make_optimizer(model: nn.Module, plan: Plan) -> torch.optim.AdamW:
    """AdamW over the trainable parameters."""
    trainable = [parameter for parameter in model.parameters() if parameter.requires_grad]
    return torch.optim.AdamW(trainable, plan.lr, betas=plan.betas, weight_decay=plan.weight_decay, fused=True)


def _batches(task: Task[Batch], plan: Plan, state: TrainingState, group: ProcessGroup) -> Iterator[tuple[int, list[Batch]]]:
    """Yield (step, micro-batches of this process) for every remaining step."""
    steps = range(plan.steps if state.stopped else state.step, plan.steps)
    numbers = ((step * plan.accumulate + part) * group.count + group.rank for step in steps for part in range(plan.accumulate))
    batches = prefetch(task.batch, numbers, plan.workers)
    for step in steps:
        yield step, [next(batches) for _ in range(plan.accumulate)]


def _optimizer_step(task: Task[Batch], model: nn.Module, batches: list[Batch], optimizer: torch.optim.Optimizer, plan: Plan,
                    group: ProcessGroup, step: int) -> dict[str, Tensor]:  # fmt: skip
    """Update the weights once; returns the losses, averaged over the micro-batches, the norm of the gradient and the rate."""
    model.train()
    optimizer.zero_grad(set_to_none=True)

    def loss(batch: Batch) -> Mapping[str, Tensor]:
        with autocast(plan.device, plan.bf16):
            return task.loss(model, batch)

    if plan.parallel > 1:
        losses = parallel_gradients(loss, batches, model, plan.parallel)
    else:
        losses = accumulate_gradients(loss, batches, model, group)
    scalars = {name: torch.stack([each[name].detach() for each in losses]).mean() for name in losses[0]}
    lr = plan.lr * warmup_decay(step, plan.warmup, plan.steps, plan.decay)
    for param_group in optimizer.param_groups:
        param_group["lr"] = lr
    scalars["grad_norm"] = nn.utils.clip_grad_norm_(task.model.parameters(), plan.clip_norm or float("inf"))
    optimizer.step()
    return {**scalars, "lr": torch.tensor(lr)}


def _validate(task: Task[Batch], state: TrainingState, plan: Plan, folder: Path) -> None:
    """Measure the model, write its previews, and keep its weights when they are the best so far."""
    task.model.eval()
    with torch.no_grad(), autocast(plan.device, plan.bf16):
        scores = task.validate()
        previews = folder / "previews"
        previews.mkdir(parents=True, exist_ok=True)
        task.preview(previews, state.step)
    state.log("val", scores)
    state.update_best(scores[task.monitor], task.model, plan.patience)


def warmup_decay(step: int, warmup: int, total: int, decay: bool = True) -> float:
    """Factor on the learning rate: linear warm-up, then linear decay to zero (WarmupDecayLR of LISA and 2HandedAfforder).

    It rises to 1 at 0-based step `warmup - 1` and falls by equal parts to 0 at step `total`; without `decay` it stays at 1.
    """
    if step < warmup or not decay:
        return min(1.0, (step + 1) / warmup)
    return max(0.0, (total - step) / max(1, total - warmup))


def prefetch(make: Callable[[int], Item], numbers: Iterable[int], workers: int, depth: int = 4) -> Iterator[Item]:
    """Yield `make(n)` for every number, in order, with up to `depth` of them computed in advance by `workers` threads.

    With 0 workers each item is computed when it is due.
    """
    if workers == 0:
        yield from map(make, numbers)
        return
    with ThreadPoolExecutor(workers) as pool:
        due: deque[Future[Item]] = deque()
        try:
            for number in numbers:
                due.append(pool.submit(make, number))
                if len(due) > depth:
                    yield due.popleft().result()
            while due:
                yield due.popleft().result()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def accumulate_gradients(loss: Loss[Batch], batches: Sequence[Batch], model: nn.Module,
                         group: ProcessGroup) -> list[Mapping[str, Tensor]]:  # fmt: skip
    """Add the mean gradient of the micro-batches to the parameters, averaged over the processes; returns their scalars."""
    found = []
    for part, batch in enumerate(batches, 1):
        with group.no_sync(model, part == len(batches)):
            found.append(loss(batch))
            (found[-1]["total"] / len(batches)).backward()
    return found


def parallel_gradients(loss: Loss[Batch], batches: Sequence[Batch], model: nn.Module, threads: int) -> list[Mapping[str, Tensor]]:
    """Compute the gradients of `accumulate_gradients` in one process, `threads` micro-batches at a time.

    On a CPU two micro-batches with a thread each finish sooner than one after the other with two threads, because operations on
    small tensors do not divide well. Gradients are summed in the order of the micro-batches, so the result is the same. The model
    must draw no random numbers and keep no statistics.

    Each worker thread gets as many threads for its operations as the caller has; by default OpenMP would give it all of them.
    """
    trainable = [parameter for parameter in model.parameters() if parameter.requires_grad]

    def one(batch: Batch) -> tuple[Mapping[str, Tensor], Gradients]:
        scalars = loss(batch)
        return scalars, torch.autograd.grad(scalars["total"] / len(batches), trainable, allow_unused=True)

    with ThreadPoolExecutor(threads, initializer=torch.set_num_threads, initargs=(torch.get_num_threads(),)) as pool:
        parts = list(pool.map(one, batches))
    for parameter, *gradients in zip(trainable, *(gradients for _, gradients in parts), strict=True):
        known = [gradient for gradient in gradients if gradient is not None]
        parameter.grad = _sum_like(parameter, known) if known else None
    return [scalars for scalars, _ in parts]


def _sum_like(parameter: Tensor, gradients: list[Tensor]) -> Tensor:
    """Sum gradients in order, in the memory layout of the parameter.

    `backward` keeps that layout, `autograd.grad` does not, and a fused optimizer walks through both in memory order.
    """
    total = torch.zeros_like(parameter)
    for gradient in gradients:
        total += gradient
    return total


def autocast(device: str, wanted: bool) -> torch.autocast:
    """Context of mixed precision: bfloat16 when it is `wanted` and the device has instructions for it.

    A CPU without such instructions would only be slower, so it computes in single precision.
    """
    return torch.autocast(torch.device(device).type, torch.bfloat16, autocasts(device, wanted))


def autocasts(device: str, wanted: bool) -> bool:
    """Return True when mixed precision is `wanted` and the device has instructions for it."""
    return wanted and (torch.device(device).type != "cpu" or has_bfloat16())


def has_bfloat16() -> bool:
    """Return True when this CPU has instructions that multiply bfloat16."""
    found = torch.cpu.get_capabilities()
    return any(found.get(name, False) for name in BFLOAT16_INSTRUCTIONS)


@contextmanager
def deterministic(threads: int, device: str) -> Iterator[None]:
    """Context of reproducible results: a fixed thread count and, on CUDA, deterministic algorithms only.

    Both settings are restored at the end. On a CPU the models here are deterministic for a given thread count. Enter the context
    before the first matrix product on a CUDA device, because cuBLAS reads its workspace setting once.
    """
    before = torch.get_num_threads(), torch.are_deterministic_algorithms_enabled()
    torch.set_num_threads(threads)
    if device == "cuda":
        os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")
        torch.use_deterministic_algorithms(True)
    try:
        yield
    finally:
        torch.set_num_threads(before[0])
        if device == "cuda":
            torch.use_deterministic_algorithms(before[1])


def derive_seed(*numbers: int) -> int:
    """Hash numbers to a 63-bit seed."""
    return int.from_bytes(blake3(repr(numbers).encode()).digest(8), "big") >> 1
