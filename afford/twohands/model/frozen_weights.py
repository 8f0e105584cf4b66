"""Weights that are not trained, kept in half precision: a frozen layer casts them to the type in which it computes, as it computes.

Parameters that are trained, and those of the prompt encoder, whose positions need all digits, stay in single precision. The image
towers, which have no gradient, compute in the type of their weights.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

STORED = ("vlm.", "regions.image_encoder.")
"""prefixes of the parameters of a `vlm` that are kept in half precision where they are frozen"""


def store_frozen(model: nn.Module, dtype: torch.dtype) -> None:
    """Keep the frozen weights of a `vlm` in `dtype`, and those that are trained in float32; also on the device meta."""
    for name, parameter in model.named_parameters():
        frozen = not parameter.requires_grad and name.startswith(STORED)
        parameter.data = parameter.data.to(dtype if frozen else torch.float32)
    cast_as_computed(model)


def cast_as_computed(model: nn.Module) -> None:
    """Replace the frozen linear layers of a `vlm` by `FrozenLinear`, in place; names of parameters stay as they are."""
    for parent in list(model.modules()):
        for name, layer in parent.named_children():
            if type(layer) is nn.Linear and not layer.weight.requires_grad:
                setattr(parent, name, FrozenLinear(layer))


class FrozenLinear(nn.Module):
    """Linear layer over frozen weights of any type; it computes in that of its input, or of mixed precision where that is on."""

    def __init__(self, layer: nn.Linear) -> None:
        super().__init__()
        self.in_features, self.out_features = layer.in_features, layer.out_features
        self.weight, self.bias = layer.weight, layer.bias

    def forward(self, x: Tensor) -> Tensor:
        """Compute (..., in) -> (..., out)."""
        kind = "cpu" if x.is_meta else x.device.type
        dtype = torch.get_autocast_dtype(kind) if torch.is_autocast_enabled(kind) else x.dtype
        found: Tensor = _Linear.apply(x.to(dtype), self.weight, self.bias)  # type: ignore[no-untyped-call]
        return found


class _Linear(torch.autograd.Function):
    """Linear map whose backward pass keeps the stored weights, not their cast copy."""

    @staticmethod
    def forward(ctx: Any, x: Tensor, weight: Tensor, bias: Tensor | None) -> Tensor:
        """Compute x W^T + b in the type of x."""
        ctx.save_for_backward(weight)
        return functional.linear(x, weight.to(x.dtype), None if bias is None else bias.to(x.dtype))

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None, None]:  # type: ignore[override]  # of one input
        """Compute the gradient of x."""
        (weight,) = ctx.saved_tensors
        return gradient @ weight.to(gradient.dtype), None, None
