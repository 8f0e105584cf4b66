"""Weights into a model, tensor by tensor, or one sentence that says which do not fit."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor, nn

NAMED = 8
"""tensors that the sentence names before it only counts"""
LONGEST = 360
"""characters that their names and shapes may take"""


def fit(model: nn.Module, tensors: Mapping[str, Tensor], where: str, hint: str) -> None:
    """Put every tensor into the one of its name. The model may be on the meta device: it then gets memory of its own.

    Buffers that only count batches may be missing. ValueError, one sentence: how many tensors are missing, extra or of another
    shape, the first of them by name, and `hint`.
    """
    own = model.state_dict()
    counters = {name: torch.zeros((), dtype=torch.int64) for name in own if name.endswith(".num_batches_tracked")}
    given = {**counters, **tensors}
    wrong = [line for name in sorted(own.keys() | given.keys()) if (line := _wrong(name, own.get(name), given.get(name)))]
    if wrong:
        named = wrong[:NAMED]
        while len(named) > 1 and sum(map(len, named)) > LONGEST:
            named.pop()
        more = f", and {len(wrong) - len(named)} more" if len(wrong) > len(named) else ""
        raise ValueError(f"{where}: {len(wrong)} of {len(own)} tensors do not fit: {', '.join(named)}{more}; {hint}")
    model.load_state_dict({name: tensor.to(own[name].dtype, copy=True) for name, tensor in given.items()}, assign=True)


def _wrong(name: str, own: Tensor | None, given: Tensor | None) -> str:
    if given is None:
        return f"missing {name}"
    if own is None:
        return f"extra {name}"
    return "" if own.shape == given.shape else f"misshaped {name}: expected {tuple(own.shape)}, got {tuple(given.shape)}"
