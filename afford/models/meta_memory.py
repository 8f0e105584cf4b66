"""Peak memory of code that runs on torch's device `meta`: the code itself runs, in full size, and no number is computed.

Floating-point tensors that depend on weights without memory have no memory either, and their bytes are counted while they live.
Whole numbers and truth values stay real, so that masks, token ids and checks of both work as they do elsewhere.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager, ExitStack, nullcontext
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional
from torch.overrides import TorchFunctionMode
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves, tree_map_only

META = torch.device("meta")
INDEXED = (torch.ops.aten.index.Tensor, torch.ops.aten.index_put.default, torch.ops.aten.index_put_.default)
"""operations whose shape depends on the truth values of a mask"""
LOWERED = frozenset((functional.linear, functional.conv2d, functional.conv_transpose2d, functional.scaled_dot_product_attention,
                     torch.matmul, torch.bmm, torch.einsum, Tensor.matmul, Tensor.__matmul__))  # fmt: skip
"""functions that mixed precision computes in its own type"""
RAISED = frozenset((functional.layer_norm, functional.cross_entropy))
"""functions that mixed precision computes in single precision"""


def peak_bytes(work: Callable[[], object], known: Iterable[Tensor] = (), mixed: torch.dtype | None = None) -> int:
    """Peak bytes of the tensors that `work` makes on the device meta, beside the `known` ones, which exist before.

    Attention is that of a fused kernel, which holds no matrix of all pairs. `mixed` is the type of mixed precision, if any. Memory
    that kernels use inside one operation is not counted.
    """
    counted = _LiveBytes(known)
    with ExitStack() as modes:
        if mixed is not None:
            modes.enter_context(torch.autocast("cpu", mixed))
        modes.enter_context(_Kernels(mixed))
        modes.enter_context(counted)
        work()
    return counted.peak


def recomputed(mixed: torch.dtype | None = None) -> tuple[AbstractContextManager[None], AbstractContextManager[Any]]:
    """Contexts of a checkpointed layer and of its recomputation (`context_fn` of torch.utils.checkpoint), for `peak_bytes`.

    The backward pass of torch calls the layer again without the modes of functions in which it ran.
    """
    return nullcontext(), _Kernels(mixed)


def tensor_bytes(tensors: Iterable[Tensor]) -> int:
    """Bytes of tensors on any device."""
    return sum(tensor.numel() * tensor.itemsize for tensor in tensors)


def model_tensors(model: nn.Module) -> list[Tensor]:
    """Parameters and buffers of a model."""
    return [*model.parameters(), *model.buffers()]


class _LiveBytes(TorchDispatchMode):
    """Bytes of the tensors on the device meta that live, and their peak."""

    def __init__(self, known: Iterable[Tensor]) -> None:
        super().__init__()
        self.live = self.peak = 0
        self.sizes: dict[int, int] = {}
        self.alive: dict[int, Any] = {}
        for tensor in known:
            self._add(tensor, 0)

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        """Run one operation, on the device meta when one of its tensors is there."""
        kwargs = kwargs or {}
        if any(tensor.is_meta for tensor in _tensors((args, kwargs))):
            if func in INDEXED:
                args = (args[0], _without_masks(args[1]), *args[2:])
            args, kwargs = tree_map_only(Tensor, lambda tensor: tensor if tensor.is_meta else tensor.to(META), (args, kwargs))
            out = func(*args, **kwargs)
        else:
            out = _real_integers(func, args, kwargs)
        for tensor in _tensors(out):
            if tensor.is_meta:
                self._add(tensor, tensor.untyped_storage().nbytes())
        return out

    def _add(self, tensor: Tensor, size: int) -> None:
        storage = tensor.untyped_storage()
        key = storage._cdata
        if key not in self.sizes:
            self.sizes[key], self.alive[key] = size, weakref.ref(storage, lambda _: self._drop(key))
            self.live += size
            self.peak = max(self.peak, self.live)

    def _drop(self, key: int) -> None:
        self.live -= self.sizes.pop(key)
        del self.alive[key]


def _tensors(tree: Any) -> list[Tensor]:
    return [leaf for leaf in tree_leaves(tree) if isinstance(leaf, Tensor)]


def _real_integers(func: Any, args: Any, kwargs: dict[str, Any]) -> Any:
    """Result of an operation without weights; whole numbers and truth values are real, also where the device meta was wanted."""
    out = func(*args, **kwargs)
    lost = isinstance(out, Tensor) and out.is_meta and not out.is_floating_point()
    return func(*args, **{**kwargs, "device": torch.device("cpu")}) if lost else out


def _without_masks(indices: Sequence[Tensor | None]) -> list[Tensor | None]:
    """Indices with the positions that a mask selects in place of the mask, since their number is a part of the shape."""
    out: list[Tensor | None] = []
    for index in indices:
        mask = index is not None and index.dtype == torch.bool and not index.is_meta
        out += index.nonzero(as_tuple=True) if mask and index is not None else [index]
    return out


class _Kernels(TorchFunctionMode):
    """Functions as a device computes them: fused attention, and the casts of mixed precision, which the device meta lacks."""

    def __init__(self, lower: torch.dtype | None) -> None:
        super().__init__()
        self.lower = lower

    def __torch_function__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        """Call a function of torch."""
        kwargs = kwargs or {}
        wanted = self._precision(func)
        if wanted is not None:
            cast = lambda one: one.to(wanted) if one.is_meta and one.is_floating_point() else one  # noqa: E731
            args, kwargs = tree_map_only(Tensor, cast, (args, kwargs))
        if func is functional.scaled_dot_product_attention and args[0].is_meta:
            return _attention(*args, **kwargs)
        return func(*args, **kwargs)

    def _precision(self, func: Any) -> torch.dtype | None:
        if self.lower is None:
            return None
        return self.lower if func in LOWERED else torch.float32 if func in RAISED else None


def _attention(query: Tensor, key: Tensor, value: Tensor, attn_mask: Tensor | None = None, dropout_p: float = 0.0,
               is_causal: bool = False, scale: float | None = None, enable_gqa: bool = False) -> Tensor:  # fmt: skip
    """Output of torch's fused attention, with its arguments; a mask of truth values becomes one of numbers."""
    if enable_gqa:
        key, value = (one.repeat_interleave(query.shape[1] // one.shape[1], 1) for one in (key, value))
    if attn_mask is not None and attn_mask.dtype == torch.bool:
        attn_mask = attn_mask.to(query.dtype)
    fused = torch.ops.aten._scaled_dot_product_flash_attention_for_cpu
    found: Tensor = fused(query, key, value, dropout_p, is_causal, attn_mask=attn_mask, scale=scale)[0]
    return found
