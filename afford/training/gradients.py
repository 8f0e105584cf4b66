"""The gradients of one step: its micro-batches one after the other, or at the same time, each in a thread of its own.

On a CPU two micro-batches beside each other, with a thread each, are done sooner than one after the other with two threads:
small tensors do not divide well. Gradients are added in the order of the micro-batches either way.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

import torch
from torch import Tensor, nn

from afford.training.ranks import Ranks
from afford.training.task import Batch

Loss = Callable[[Batch], Mapping[str, Tensor]]
"""a micro-batch -> named scalars, of which `total` is minimised"""
Gradients = tuple[Tensor | None, ...]


def one_by_one(loss: Loss[Batch], batches: Sequence[Batch], model: nn.Module, ranks: Ranks) -> list[Mapping[str, Tensor]]:
    """Add the mean gradient of the micro-batches to the parameters, averaged over the processes; returns their scalars."""
    found = []
    for part, batch in enumerate(batches, 1):
        with ranks.quiet(model, part == len(batches)):
            found.append(loss(batch))
            (found[-1]["total"] / len(batches)).backward()
    return found


def together(loss: Loss[Batch], batches: Sequence[Batch], model: nn.Module, threads: int) -> list[Mapping[str, Tensor]]:
    """The same in one process, `threads` micro-batches at a time. The model must draw nothing at random and keep nothing.

    Inside an operation each has as many threads as the caller: a new thread must be told, else OpenMP gives it all there are.
    """
    learned = [parameter for parameter in model.parameters() if parameter.requires_grad]

    def one(batch: Batch) -> tuple[Mapping[str, Tensor], Gradients]:
        found = loss(batch)
        return found, torch.autograd.grad(found["total"] / len(batches), learned, allow_unused=True)

    with ThreadPoolExecutor(threads, initializer=torch.set_num_threads, initargs=(torch.get_num_threads(),)) as pool:
        parts = list(pool.map(one, batches))
    for parameter, *gradients in zip(learned, *(gradients for _, gradients in parts), strict=True):
        known = [gradient for gradient in gradients if gradient is not None]
        parameter.grad = _sum(parameter, known) if known else None
    return [found for found, _ in parts]


def _sum(parameter: Tensor, gradients: list[Tensor]) -> Tensor:
    """In their order, in the memory layout of the parameter: `backward` sees to that, `grad` does not, and a fused optimiser goes
    through both as they lie.
    """
    total = torch.zeros_like(parameter)
    for gradient in gradients:
        total += gradient
    return total
