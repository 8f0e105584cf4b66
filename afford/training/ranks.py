"""The processes that train together: one, or as many as the standard launcher has started."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass

import torch
from torch import distributed, nn
from torch.nn.parallel import DistributedDataParallel


@dataclass(frozen=True)
class Ranks:
    """Which of `count` processes this one is."""

    rank: int = 0
    count: int = 1

    @property
    def first(self) -> bool:
        """Whether this process writes files and validates."""
        return self.rank == 0

    def wrap(self, model: nn.Module) -> nn.Module:
        """The model, with gradients averaged over all processes after each backward pass."""
        return DistributedDataParallel(model) if self.count > 1 else model

    def quiet(self, model: nn.Module, last: bool) -> AbstractContextManager[None]:
        """Gradients are exchanged on the last micro-batch of a step only."""
        return model.no_sync() if isinstance(model, DistributedDataParallel) and not last else nullcontext()

    def agree(self, stop: bool) -> bool:
        """What the first process has decided."""
        if self.count == 1:
            return stop
        word = [stop]
        distributed.broadcast_object_list(word, src=0)
        return word[0]


ALONE = Ranks()


@contextmanager
def launched(device: str) -> Iterator[Ranks]:
    """The processes that `torch.distributed.run` has started around this one; this process alone without it."""
    if "WORLD_SIZE" not in os.environ:
        yield ALONE
        return
    if device == "cuda":
        torch.cuda.set_device(int(os.environ["LOCAL_RANK"]))
    distributed.init_process_group("nccl" if device == "cuda" else "gloo")
    try:
        yield Ranks(distributed.get_rank(), distributed.get_world_size())
    finally:
        distributed.destroy_process_group()
