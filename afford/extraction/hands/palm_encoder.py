"""Frozen encoder of the hand finder: the feature maps of MediaPipe's palm detector, which was trained on real hands.

The detector is fully convolutional up to its heads, so the encoder takes pictures of any size. Its weights are read from the TFLite
file through OpenCV.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate, max_pool2d, pad

STAGES = ((32, 4), (64, 5), (128, 5), (256, 5), (256, 5))
"""channels and blocks of the stages at strides 2, 4, 8, 16 and 32"""
KERNEL = 5
HEADS = (2, 6, 36, 108)
"""output channels of the heads, which the encoder lacks"""
AGAIN = "run `make setup` to fetch the file again"
LAYERS = ("Convolution", "PReLU")
"""layers of the TFLite file that hold weights"""


class PalmEncoder(nn.Module):
    """Feature maps of the palm detector at strides 2, 4, 8 and 16; pictures (b, 3, h, w), RGB 0..1.

    The maps have 32, 64, 128 and 256 channels; those at strides 8 and 16 are the ones from which the detector predicts palms. All
    parameters are frozen.
    """

    widths = (32, 64, 128, 256)

    def __init__(self) -> None:
        super().__init__()
        self.stem = nn.Sequential(_Convolution(3, 32, KERNEL, 2), nn.PReLU(32))
        before, stages = 32, list[nn.Module]()
        for number, (width, blocks) in enumerate(STAGES):
            first = _Block(before, width, 2 if number else 1)
            stages.append(nn.Sequential(first, *(_Block(width, width) for _ in range(blocks - 1))))
            before = width
        self.stages = nn.ModuleList(stages)
        self.top_down = nn.ModuleList([_TopDown(256, 256), _TopDown(256, 128)])
        for parameter in self.parameters():
            parameter.requires_grad_(False)

    @torch.no_grad()
    def forward(self, pictures: Tensor) -> tuple[Tensor, ...]:
        """Compute the feature maps, the largest first."""
        seen = [self.stages[0](self.stem(pictures))]
        for stage in self.stages[1:]:
            seen.append(stage(seen[-1]))
        high, middle = self.top_down
        coarse = high(seen[4], seen[3])
        return seen[0], seen[1], middle(coarse, seen[2]), coarse


class _Convolution(nn.Module):
    """Convolution with TensorFlow's padding SAME."""

    def __init__(self, before: int, after: int, kernel: int, stride: int = 1, groups: int = 1) -> None:
        super().__init__()
        self.convolution = nn.Conv2d(before, after, kernel, stride, groups=groups)

    def forward(self, x: Tensor) -> Tensor:
        (kernel, _), (stride, _) = self.convolution.kernel_size, self.convolution.stride
        down, across = (max((-(-side // stride) - 1) * stride + kernel - side, 0) for side in x.shape[-2:])
        return self.convolution(pad(x, (across // 2, across - across // 2, down // 2, down - down // 2)))


class _Block(nn.Module):
    """Depthwise and pointwise convolution beside a shortcut."""

    def __init__(self, before: int, after: int, stride: int = 1) -> None:
        super().__init__()
        self.depthwise = _Convolution(before, before, KERNEL, stride, before)
        self.pointwise = _Convolution(before, after, 1)
        self.activation = nn.PReLU(after)
        self.more, self.stride = after - before, stride

    def forward(self, x: Tensor) -> Tensor:
        short = max_pool2d(x, 2, ceil_mode=True) if self.stride == 2 else x
        return self.activation(self.pointwise(self.depthwise(x)) + pad(short, (0, 0, 0, 0, 0, self.more)))


class _TopDown(nn.Module):
    """Level of the feature pyramid: the coarser map, resized, is added to the finer one."""

    def __init__(self, before: int, after: int) -> None:
        super().__init__()
        self.lateral = nn.Sequential(_Convolution(before, after, 1), nn.PReLU(after))
        self.blocks = nn.Sequential(_Block(after, after), _Block(after, after))

    def forward(self, coarse: Tensor, fine: Tensor) -> Tensor:
        size = (fine.shape[-2], fine.shape[-1])
        return self.blocks(fine + self.lateral(interpolate(coarse, size, mode="bilinear", align_corners=False)))


def read_palm_encoder(model: Path) -> PalmEncoder:
    """Read the encoder from the TFLite file of the full palm detector. ValueError for another network."""
    encoder = PalmEncoder()
    own = [layer for layer in encoder.modules() if isinstance(layer, nn.Conv2d | nn.PReLU)]
    given = _weights(model)
    if [sum(p.numel() for p in layer.parameters()) for layer in own] != [sum(blob.size for blob in blobs) for blobs in given]:
        raise ValueError(f"{model}: expected MediaPipe's full palm detector; {AGAIN}")
    for layer, blobs in zip(own, given, strict=True):
        for parameter, blob in zip(layer.parameters(), blobs, strict=True):
            parameter.data = torch.from_numpy(blob.reshape(parameter.shape).copy())
    return encoder


def _weights(model: Path) -> list[list[np.ndarray]]:
    """Weights of the layers of the encoder in the order of the file, which is that of the modules; the heads are left out."""
    try:
        network = cv2.dnn.readNetFromTFLite(str(model), engine=cv2.dnn.ENGINE_CLASSIC)
    except cv2.error as error:
        raise ValueError(f"{model}: not a TFLite network that OpenCV reads; {AGAIN}") from error
    layers: list[Any] = [network.getLayer(network.getLayerId(name)) for name in network.getLayerNames()]
    blobs = [[np.asarray(blob, np.float32) for blob in layer.blobs] for layer in layers if layer.type in LAYERS]
    return [one for one in blobs if one[0].shape[0] not in HEADS]
