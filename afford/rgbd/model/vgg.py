"""An encoder from a local VGG16 checkpoint: its first 11 convolutions have the shapes of the paper's encoder."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from afford.models.tensor_files import load_weights_only
from afford.rgbd.model.encoder import Encoder

LAYERS = (0, 2, 5, 7, 10, 12, 14, 17, 19, 21, 24)
"""numbers of VGG16's first 11 convolutions in `features.<number>.weight`; the two poolings after the third are left out"""


def fill(encoder: Encoder, checkpoint: Path) -> None:
    """Put the weights of a VGG16 (.pth of tensors, or .safetensors) into an encoder. A fourth channel (depth) gets the mean of the
    first three. ValueError for a tensor that is missing or of another shape.
    """
    found = load_weights_only(checkpoint, "the weights of a VGG16 as tensors by name")
    convolutions = [module for module in encoder.modules() if isinstance(module, nn.Conv2d)]
    with torch.no_grad():
        for conv, number in zip(convolutions, LAYERS, strict=True):
            for name, target in (("weight", conv.weight), ("bias", conv.bias)):
                assert target is not None
                target.copy_(_fitting(found, f"features.{number}.{name}", target, checkpoint))


def _fitting(found: dict[str, Any], name: str, target: Tensor, checkpoint: Path) -> Tensor:
    given = found.get(name)
    tensor = given if isinstance(given, Tensor) else None
    if tensor is not None and target.dim() == 4 and target.shape[1] == 4 and tensor.shape[1] == 3:
        tensor = torch.cat([tensor, tensor.mean(1, keepdim=True)], 1)
    if tensor is None or tensor.shape != target.shape:
        got = "none" if tensor is None else str(tuple(tensor.shape))
        raise ValueError(f"{checkpoint}: expected {name} of shape {tuple(target.shape)}, got {got}; a VGG16 fits the width `paper`")
    return tensor
