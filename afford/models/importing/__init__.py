"""Import of published checkpoints: what a kind of checkpoint is, and the files that it becomes.

A kind reads tensors by their published names, which are memory-mapped, and returns the files of a model that this project loads:
configs as text, and tensors under the names of the model, with the shapes that the model expects.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from torch import Tensor, nn

from afford.models.importing.source import Source


@dataclass(frozen=True)
class Imported:
    """A model as it will be written."""

    title: str
    """what it is, with its size: SAM 2.1 hiera large"""
    use: str
    """what it is good for here, as the words of a command"""
    texts: Mapping[str, str]
    """configs and tokenizers: name of the file -> its text"""
    tensors: Mapping[str, Tensor]
    """tensors by their names in the model, memory-mapped"""
    expected: Mapping[str, Tensor]
    """tensors of the model, on the device meta: names and shapes that `tensors` must have"""
    fresh: tuple[str, ...] = ()
    """tensors that the published format lacks, with values of their own"""
    keep: tuple[str, ...] = ()
    """prefixes of tensors that stay in float32, whatever type is asked for"""
    single: bool = False
    """the model is read from one file, however large"""
    counted: int = 0
    """parameters of the published model, where they are not those of `expected`"""
    notes: tuple[str, ...] = ()
    """sentences for its user"""


Kind = Callable[[Source], Imported]
"""reader of one kind of checkpoint; ValueError, one sentence, where it is another one"""


def shapes_of(model: nn.Module) -> dict[str, Tensor]:
    """Names and shapes of the tensors of a model on the device meta."""
    return dict(model.state_dict())


def leading(tensors: Mapping[str, Any], pattern: str) -> int:
    """Number of layers: one more than the largest number at the place of `*` in names that begin with `pattern`."""
    before, _, after = pattern.partition("*")
    found = [name.removeprefix(before).partition(".")[0] for name in tensors
             if name.startswith(before) and after in name.removeprefix(before)]  # fmt: skip
    return max((int(number) + 1 for number in found if number.isdigit()), default=0)


def parameter_count(given: Mapping[str, Tensor], buffers: tuple[str, ...] = ()) -> int:
    """Number of parameters; tensors whose names end with one of `buffers` do not count."""
    return sum(tensor.numel() for name, tensor in given.items() if not (buffers and name.endswith(buffers)))


def need(tensors: Mapping[str, Tensor], name: str, what: str) -> Tensor:
    """Tensor of a name that decides the size of a model. ValueError, one sentence, without it."""
    if name not in tensors:
        raise ValueError(f"expected {what}, which has the tensor {name}, got another checkpoint of {len(tensors)} tensors "
                         f"({', '.join(sorted(tensors)[:3])}, ...)")  # fmt: skip
    return tensors[name]
