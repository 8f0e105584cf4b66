"""Network of XMem (Cheng and Schwing 2022): encoders of keys and values, sensory memory, and decoder of masks.

Modules have the names of the released code, so that its tensors fit. The objects of a frame are the batch of every part that sees
masks; the picture has a batch of one. Sizes are multiples of 16 px.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d, interpolate, max_pool2d, relu

STRIDE_PX = 16
"""pixels per key and value"""
REDUCTION = 16
"""channels of an attention map per hidden unit"""
KEY_BLOCKS, VALUE_BLOCKS = (3, 4, 6), (2, 2, 2)
"""residual blocks of the first three stages of ResNet-50 and ResNet-18"""
EXPANSION = 4
"""output channels of a bottleneck per inner channel"""
MASK_CHANNELS = 2
"""input channels besides colours: the mask of an object, and those of all others"""


@dataclass(frozen=True)
class XMemConfig:
    """Sizes of the network. The defaults are those of the release."""

    width: int = 64
    """channels of the first convolution; all others but those below are multiples of it"""
    key_dim: int = 64
    value_dim: int = 512
    hidden_dim: int = 64
    """channels of the sensory memory"""


class Features(NamedTuple):
    """Features of a picture, coarse to fine."""

    stride16: Tensor
    """(1, 16 width, h / 16, w / 16)"""
    stride8: Tensor
    """(1, 8 width, h / 8, w / 8)"""
    stride4: Tensor
    """(1, 4 width, h / 4, w / 4)"""


class Keys(NamedTuple):
    """Keys of the N = (h / 16) (w / 16) places of a picture."""

    key: Tensor
    """(N, key_dim) float32"""
    shrinkage: Tensor
    """(N, 1) float32, at least 1: confidence of a key in memory"""
    selection: Tensor
    """(N, key_dim) float32 in 0..1: channels that count when the key is a query"""


class XMem(nn.Module):
    """XMem without its memory."""

    def __init__(self, config: XMemConfig = XMemConfig()) -> None:
        super().__init__()
        self.config = config
        wide, deep = EXPANSION * config.width, 4 * EXPANSION * config.width
        self.key_encoder = KeyEncoder(config.width)
        self.value_encoder = ValueEncoder(config, deep)
        self.key_proj = KeyProjection(deep, config.key_dim)
        self.decoder = Decoder(config, wide, deep)

    def encode_key(self, image: Tensor) -> tuple[Keys, Features]:
        """Keys and features of a normalised picture (1, 3, h, w)."""
        features = self.key_encoder(image)
        return self.key_proj(features.stride16), features

    def encode_value(self, image: Tensor, features: Features, masks: Tensor) -> Tensor:
        """Values (n, value_dim, h / 16, w / 16) of n objects with masks (n, h, w) in 0..1."""
        others = masks.sum(dim=0, keepdim=True) - masks
        return self.value_encoder(image, features.stride16, torch.stack([masks, others], dim=1))

    def deep_update(self, value: Tensor, hidden: Tensor) -> Tensor:
        """Sensory memory (n, hidden_dim, h / 16, w / 16) after a frame was stored with `value`."""
        return self.value_encoder.hidden_reinforce(value, hidden)


class BasicBlock(nn.Module):
    """Residual block of ResNet-18 (He et al. 2016)."""

    def __init__(self, before: int, after: int, stride: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(before, after, 3, stride, 1, bias=False)
        self.bn1 = nn.BatchNorm2d(after)
        self.conv2 = nn.Conv2d(after, after, 3, 1, 1, bias=False)
        self.bn2 = nn.BatchNorm2d(after)
        self.downsample = _shortcut(before, after, stride)

    def forward(self, x: Tensor) -> Tensor:
        """(b, before, h, w) -> (b, after, h / stride, w / stride)."""
        y = self.bn2(self.conv2(relu(self.bn1(self.conv1(x)))))
        return relu(y + (x if self.downsample is None else self.downsample(x)))


class Bottleneck(nn.Module):
    """Residual block of ResNet-50; the stride is that of its 3 x 3 convolution."""

    def __init__(self, before: int, after: int, stride: int) -> None:
        super().__init__()
        inner = after // EXPANSION
        self.conv1 = nn.Conv2d(before, inner, 1, bias=False)
        self.bn1 = nn.BatchNorm2d(inner)
        self.conv2 = nn.Conv2d(inner, inner, 3, stride, 1, bias=False)
        self.bn2 = nn.BatchNorm2d(inner)
        self.conv3 = nn.Conv2d(inner, after, 1, bias=False)
        self.bn3 = nn.BatchNorm2d(after)
        self.downsample = _shortcut(before, after, stride)

    def forward(self, x: Tensor) -> Tensor:
        """(b, before, h, w) -> (b, after, h / stride, w / stride)."""
        y = relu(self.bn2(self.conv2(relu(self.bn1(self.conv1(x))))))
        return relu(self.bn3(self.conv3(y)) + (x if self.downsample is None else self.downsample(x)))


def _shortcut(before: int, after: int, stride: int) -> nn.Sequential | None:
    if stride == 1 and before == after:
        return None
    return nn.Sequential(nn.Conv2d(before, after, 1, stride, bias=False), nn.BatchNorm2d(after))


def _stage(block: type[BasicBlock] | type[Bottleneck], count: int, before: int, after: int, stride: int) -> nn.Sequential:
    return nn.Sequential(block(before, after, stride), *(block(after, after, 1) for _ in range(count - 1)))


class KeyEncoder(nn.Module):
    """ResNet-50 up to stride 16."""

    def __init__(self, width: int) -> None:
        super().__init__()
        four, eight, sixteen = (EXPANSION * width * 2**stage for stage in range(3))
        self.conv1 = nn.Conv2d(3, width, 7, 2, 3, bias=False)
        self.bn1 = nn.BatchNorm2d(width)
        self.res2 = _stage(Bottleneck, KEY_BLOCKS[0], width, four, 1)
        self.layer2 = _stage(Bottleneck, KEY_BLOCKS[1], four, eight, 2)
        self.layer3 = _stage(Bottleneck, KEY_BLOCKS[2], eight, sixteen, 2)

    def forward(self, image: Tensor) -> Features:
        """Encode a picture (1, 3, h, w)."""
        stride4 = self.res2(max_pool2d(relu(self.bn1(self.conv1(image))), 3, 2, 1))
        stride8 = self.layer2(stride4)
        return Features(self.layer3(stride8), stride8, stride4)


class KeyProjection(nn.Module):
    """Projection of features to keys, with shrinkage and selection."""

    def __init__(self, before: int, key_dim: int) -> None:
        super().__init__()
        self.key_proj = nn.Conv2d(before, key_dim, 3, padding=1)
        self.d_proj = nn.Conv2d(before, 1, 3, padding=1)
        self.e_proj = nn.Conv2d(before, key_dim, 3, padding=1)

    def forward(self, x: Tensor) -> Keys:
        """Project features (1, before, h, w); keys are float32, since squared distances of half numbers are coarse."""
        key, shrinkage, selection = (part(x)[0].flatten(1).T.float() for part in (self.key_proj, self.d_proj, self.e_proj))
        return Keys(key, shrinkage**2 + 1, selection.sigmoid())


class ValueEncoder(nn.Module):
    """ResNet-18 up to stride 16 on a picture with masks, fused with the features of the picture alone."""

    def __init__(self, config: XMemConfig, deep: int) -> None:
        super().__init__()
        one, two, four = (config.width * 2**stage for stage in range(3))
        self.conv1 = nn.Conv2d(3 + MASK_CHANNELS, one, 7, 2, 3, bias=False)
        self.bn1 = nn.BatchNorm2d(one)
        self.layer1 = _stage(BasicBlock, VALUE_BLOCKS[0], one, one, 1)
        self.layer2 = _stage(BasicBlock, VALUE_BLOCKS[1], one, two, 2)
        self.layer3 = _stage(BasicBlock, VALUE_BLOCKS[2], two, four, 2)
        self.fuser = Fusion(deep + four, config.value_dim, config.value_dim)
        self.hidden_reinforce = DeepUpdate(config.value_dim, config.hidden_dim)

    def forward(self, image: Tensor, stride16: Tensor, masks: Tensor) -> Tensor:
        """Values (n, value_dim, h / 16, w / 16) of a picture (1, 3, h, w) with masks (n, 2, h, w)."""
        x = torch.cat([image.expand(len(masks), -1, -1, -1), masks.to(image.dtype)], dim=1)
        x = max_pool2d(relu(self.bn1(self.conv1(x))), 3, 2, 1)
        return self.fuser(stride16, self.layer3(self.layer2(self.layer1(x))))


class ResidualBlock(nn.Module):
    """Two convolutions after ReLU, without normalisation; the shortcut is a convolution where channels differ."""

    def __init__(self, before: int, after: int) -> None:
        super().__init__()
        self.downsample = None if before == after else nn.Conv2d(before, after, 3, padding=1)
        self.conv1 = nn.Conv2d(before, after, 3, padding=1)
        self.conv2 = nn.Conv2d(after, after, 3, padding=1)

    def forward(self, x: Tensor) -> Tensor:
        """(n, before, h, w) -> (n, after, h, w)."""
        y = self.conv2(relu(self.conv1(relu(x))))
        return y + (x if self.downsample is None else self.downsample(x))


class ChannelGate(nn.Module):
    """Channel attention of CBAM (Woo et al. 2018), from the mean and the maximum over the picture."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        inner = max(channels // REDUCTION, 1)
        self.mlp = nn.Sequential(nn.Flatten(), nn.Linear(channels, inner), nn.ReLU(), nn.Linear(inner, channels))

    def forward(self, x: Tensor) -> Tensor:
        """Scale the channels of (n, c, h, w)."""
        scale = self.mlp(x.mean(dim=(2, 3))) + self.mlp(x.amax(dim=(2, 3)))
        return x * scale.sigmoid()[:, :, None, None]


class SpatialGate(nn.Module):
    """Spatial attention of CBAM, from the maximum and the mean over channels."""

    def __init__(self) -> None:
        super().__init__()
        self.spatial = nn.ModuleDict({"conv": nn.Conv2d(2, 1, 7, padding=3)})

    def forward(self, x: Tensor) -> Tensor:
        """Scale the places of (n, c, h, w)."""
        pooled = torch.cat([x.amax(dim=1, keepdim=True), x.mean(dim=1, keepdim=True)], dim=1)
        return x * self.spatial["conv"](pooled).sigmoid()


class Fusion(nn.Module):
    """Fusion of the features of a picture with those of its objects: a residual block, attention, another block."""

    def __init__(self, before: int, inner: int, after: int) -> None:
        super().__init__()
        self.block1 = ResidualBlock(before, inner)
        self.attention = nn.ModuleDict({"ChannelGate": ChannelGate(inner), "SpatialGate": SpatialGate()})
        self.block2 = ResidualBlock(inner, after)

    def forward(self, picture: Tensor, objects: Tensor) -> Tensor:
        """Fuse (1, c, h, w) and (n, c', h, w) to (n, after, h, w)."""
        x = self.block1(torch.cat([picture.expand(len(objects), -1, -1, -1), objects], dim=1))
        return self.block2(x + self.attention["SpatialGate"](self.attention["ChannelGate"](x)))


def gated(values: Tensor, hidden: Tensor) -> Tensor:
    """Update a sensory memory (n, c, h, w) by the values (n, 3 c, h, w) of its forget gate, update gate and candidate.

    As released, the candidate does not see the forget gate, which scales the old state.
    """
    forget, update, candidate = values.chunk(3, dim=1)
    update = update.sigmoid()
    return forget.sigmoid() * hidden * (1 - update) + update * candidate.tanh()


class DeepUpdate(nn.Module):
    """Update of the sensory memory by the value of a stored frame."""

    def __init__(self, value_dim: int, hidden_dim: int) -> None:
        super().__init__()
        self.transform = nn.Conv2d(value_dim + hidden_dim, 3 * hidden_dim, 3, padding=1)

    def forward(self, value: Tensor, hidden: Tensor) -> Tensor:
        """(n, value_dim, h, w), (n, hidden_dim, h, w) -> (n, hidden_dim, h, w)."""
        return gated(self.transform(torch.cat([value, hidden], dim=1)), hidden)


class SensoryUpdate(nn.Module):
    """Update of the sensory memory by the features of the decoder at strides 16, 8 and 4."""

    def __init__(self, deep: int, wide: int, hidden_dim: int) -> None:
        super().__init__()
        self.g16_conv = nn.Conv2d(deep, wide, 1)
        self.g8_conv = nn.Conv2d(wide, wide, 1)
        self.g4_conv = nn.Conv2d(wide + 1, wide, 1)
        self.transform = nn.Conv2d(wide + hidden_dim, 3 * hidden_dim, 3, padding=1)

    def forward(self, stride16: Tensor, stride8: Tensor, stride4: Tensor, hidden: Tensor) -> Tensor:
        """Sensory memory (n, hidden_dim, h / 16, w / 16) after a frame was decoded."""
        seen = self.g16_conv(stride16) + self.g8_conv(avg_pool2d(stride8, 2)) + self.g4_conv(avg_pool2d(stride4, 4))
        return gated(self.transform(torch.cat([seen, hidden], dim=1)), hidden)


class Upsample(nn.Module):
    """Doubling of the resolution, with the features of the picture added."""

    def __init__(self, skip: int, before: int, after: int) -> None:
        super().__init__()
        self.skip_conv = nn.Conv2d(skip, before, 3, padding=1)
        self.out_conv = ResidualBlock(before, after)

    def forward(self, picture: Tensor, objects: Tensor) -> Tensor:
        """(1, skip, 2 h, 2 w), (n, before, h, w) -> (n, after, 2 h, 2 w)."""
        larger = interpolate(objects, scale_factor=2, mode="bilinear", align_corners=False)
        return self.out_conv(self.skip_conv(picture) + larger)


class Decoder(nn.Module):
    """Decoder of what was read from memory into mask logits, and update of the sensory memory."""

    def __init__(self, config: XMemConfig, wide: int, deep: int) -> None:
        super().__init__()
        half = deep // 2
        self.fuser = Fusion(deep + config.value_dim + config.hidden_dim, half, half)
        self.hidden_update = SensoryUpdate(half, wide, config.hidden_dim)
        self.up_16_8 = Upsample(half, half, wide)
        self.up_8_4 = Upsample(wide, wide, wide)
        self.pred = nn.Conv2d(wide, 1, 3, padding=1)

    def forward(self, features: Features, read: Tensor, hidden: Tensor, *, update: bool = True) -> tuple[Tensor, Tensor]:
        """Logits (n, h, w) of n objects and their sensory memory, which stays as it is without `update`.

        read: (n, value_dim, h / 16, w / 16) from memory. hidden: (n, hidden_dim, h / 16, w / 16).
        """
        sixteen = self.fuser(features.stride16, torch.cat([read, hidden], dim=1))
        eight = self.up_16_8(features.stride8, sixteen)
        four = self.up_8_4(features.stride4, eight)
        logits = self.pred(relu(four))
        if update:
            hidden = self.hidden_update(sixteen, eight, torch.cat([four, logits], dim=1), hidden)
        return interpolate(logits, scale_factor=4, mode="bilinear", align_corners=False)[:, 0], hidden
