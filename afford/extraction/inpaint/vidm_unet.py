"""U-Net of VIDM and its config: convolutions within each frame, attention over all frames, and one convolution over time.

Modules have the names of the latent diffusion code base (Rombach et al. 2022), so that published tensors fit.
"""

from __future__ import annotations

import dataclasses
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d, interpolate, scaled_dot_product_attention

FORMAT = "afford-vidm-1"


@dataclass(frozen=True)
class VidmConfig:
    """Sizes of VIDM. The defaults are those of the published model (2HandedAfforder, hand inpainting)."""

    size_px: int = 256
    """side of the square frames; the side of a latent is a quarter"""
    frames: int = 4
    """frames of a group, the target last"""
    channels: int = 256
    """channels of the U-Net at its finest level; a multiple of 32"""
    multiples: tuple[int, ...] = (1, 2, 3, 4)
    """multiples of `channels`, by level"""
    blocks: int = 2
    """residual blocks of a level"""
    attention_at: tuple[int, ...] = (2, 4, 8)
    """strides of the latent with attention among all positions of all frames"""
    heads: int = 8
    codes: int = 8192
    """entries of the codebook"""
    first_stage: tuple[int, ...] = (128, 256, 512)
    """channels of the levels between a frame and its latent; three levels give stride 4"""
    first_stage_blocks: int = 2


def read_config(path: Path) -> VidmConfig:
    """Read the config of a saved model; ValueError names the file and the field."""
    try:
        fields = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise ValueError(f"{path}: expected the config of a saved VIDM; {error}") from error
    if not isinstance(fields, dict) or fields.pop("format", None) != FORMAT:
        raise ValueError(f'{path}: expected "format": "{FORMAT}"; '
                         'write the folder with afford.extraction.inpaint.vidm_model.save')
    unknown = sorted(fields.keys() - {field.name for field in dataclasses.fields(VidmConfig)})
    if unknown:
        raise ValueError(f"{path}: unknown fields {', '.join(unknown)}; remove them, VidmConfig has no such fields")
    plain: dict[str, Any] = {name: tuple(value) if isinstance(value, list) else value for name, value in fields.items()}
    return VidmConfig(**plain)


def config_text(config: VidmConfig) -> str:
    """Serialise a config as the JSON text that `read_config` reads."""
    return json.dumps({"format": FORMAT, **dataclasses.asdict(config)}, indent=2, sort_keys=True) + "\n"


GROUPS = 32
LATENT, CONDITION = 3, 4
"""channels of a latent; channels of the condition of a frame: its latent with the hole black, and its mask"""
MAX_PERIOD = 10_000


class Unet(nn.Module):
    """Noise predictor: (b, 7, t, h, w) noisy target with the condition of each frame, and (b,) steps -> (b, 3, h, w) noise."""

    def __init__(self, config: VidmConfig) -> None:
        super().__init__()
        self.channels, self.emb = config.channels, 4 * config.channels
        self.time_embed = nn.Sequential(nn.Linear(self.channels, self.emb), nn.SiLU(), nn.Linear(self.emb, self.emb))
        self.input_blocks, skips = self._down(config)
        deep = skips[-1]
        self.middle_block = Block([self._res(deep, deep), Attention(deep, config.heads), self._res(deep, deep)])
        self.output_blocks = self._up(config, skips)
        first = config.channels * config.multiples[0]
        join = nn.Conv3d(first, first, (config.frames, 1, 1))
        self.out = nn.Sequential(Norm(GROUPS, first), nn.SiLU(), join, FrameMean(), nn.Conv2d(first, LATENT, 3, padding=1))

    def forward(self, x: Tensor, step: Tensor) -> Tensor:
        """Predict noise, see the class."""
        emb = self.time_embed(timestep_embedding(step, self.channels).to(x.dtype))
        skips = []
        for block in self.input_blocks:
            x = block(x, emb)
            skips.append(x)
        x = self.middle_block(x, emb)
        for block in self.output_blocks:
            x = block(torch.cat([x, skips.pop()], 1), emb)
        return self.out(x)

    def _down(self, config: VidmConfig) -> tuple[nn.ModuleList, list[int]]:
        blocks = [Block([frame_conv(LATENT + CONDITION, self.channels)])]
        skips, stride = [self.channels], 1
        for level, multiple in enumerate(config.multiples):
            for _ in range(config.blocks):
                blocks.append(Block(self._level(skips[-1], config.channels * multiple, stride, config)))
                skips.append(config.channels * multiple)
            if level < len(config.multiples) - 1:
                blocks.append(Block([self._res(skips[-1], skips[-1], "down")]))
                skips.append(skips[-1])
                stride *= 2
        return nn.ModuleList(blocks), skips

    def _up(self, config: VidmConfig, skips: list[int]) -> nn.ModuleList:
        blocks, now, left = [], skips[-1], list(skips)
        for level, multiple in reversed(list(enumerate(config.multiples))):
            for number in range(config.blocks + 1):
                layers = self._level(now + left.pop(), config.channels * multiple, 2**level, config)
                now = config.channels * multiple
                if level and number == config.blocks:
                    layers.append(self._res(now, now, "up"))
                blocks.append(Block(layers))
        return nn.ModuleList(blocks)

    def _level(self, channels_in: int, channels_out: int, stride: int, config: VidmConfig) -> list[nn.Module]:
        attention = [Attention(channels_out, config.heads)] if stride in config.attention_at else []
        return [self._res(channels_in, channels_out), *attention]

    def _res(self, channels_in: int, channels_out: int, resample: str = "") -> Residual:
        return Residual(channels_in, channels_out, self.emb, resample)


class Block(nn.ModuleList):
    """Sequence of layers; residual layers also receive the step embedding."""

    def forward(self, x: Tensor, emb: Tensor) -> Tensor:
        """Apply the layers: (b, c, t, h, w) -> (b, c', t, h', w')."""
        for layer in self:
            x = layer(x, emb) if isinstance(layer, Residual) else layer(x)
        return x


class Residual(nn.Module):
    """Residual block of two convolutions within each frame; `resample` "down" halves, "up" doubles height and width."""

    def __init__(self, channels_in: int, channels_out: int, emb: int, resample: str = "") -> None:
        super().__init__()
        self.resample = {"": nn.Identity(), "down": Downsample(), "up": Upsample()}[resample]
        self.in_layers = nn.Sequential(Norm(GROUPS, channels_in), nn.SiLU(), frame_conv(channels_in, channels_out))
        self.emb_layers = nn.Sequential(nn.SiLU(), nn.Linear(emb, channels_out))
        last = frame_conv(channels_out, channels_out)
        self.out_layers = nn.Sequential(Norm(GROUPS, channels_out), nn.SiLU(), nn.Identity(), last)
        self.skip_connection = nn.Identity() if channels_in == channels_out else nn.Conv3d(channels_in, channels_out, 1)

    def forward(self, x: Tensor, emb: Tensor) -> Tensor:
        """Apply the block: (b, c, t, h, w), (b, e) -> (b, c', t, h', w')."""
        h = self.in_layers[2](self.resample(self.in_layers[:2](x)))
        h = h + self.emb_layers(emb)[:, :, None, None, None]
        return self.skip_connection(self.resample(x)) + self.out_layers(h)


class Attention(nn.Module):
    """Self-attention over all positions of all frames."""

    def __init__(self, channels: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.norm = Norm(GROUPS, channels)
        self.qkv = nn.Conv1d(channels, 3 * channels, 1)
        self.proj_out = nn.Conv1d(channels, channels, 1)

    def forward(self, x: Tensor) -> Tensor:
        """Attend within (b, c, t, h, w); the shape is unchanged."""
        flat = x.flatten(2)
        per_head = self.qkv(self.norm(flat)).unflatten(1, (self.heads, -1)).transpose(2, 3)
        q, k, v = per_head.chunk(3, dim=3)
        seen = scaled_dot_product_attention(q, k, v).transpose(2, 3).flatten(1, 2)
        return (flat + self.proj_out(seen)).view_as(x)


class Norm(nn.GroupNorm):
    """Group normalisation over all frames together, computed in float32."""

    def forward(self, x: Tensor) -> Tensor:
        """Normalise; shape and type are unchanged."""
        scale, shift = self.weight.float(), self.bias.float()
        return torch.nn.functional.group_norm(x.float(), self.num_groups, scale, shift, self.eps).to(x.dtype)


class Downsample(nn.Module):
    """Downsampling by the mean of 2 x 2 pixels of a frame."""

    def forward(self, x: Tensor) -> Tensor:
        """Downsample (b, c, t, h, w) to (b, c, t, h / 2, w / 2)."""
        return avg_pool2d(x.flatten(1, 2), 2).unflatten(1, x.shape[1:3])


class Upsample(nn.Module):
    """Nearest-neighbour upsampling of each frame."""

    def forward(self, x: Tensor) -> Tensor:
        """Upsample (b, c, t, h, w) to (b, c, t, 2 h, 2 w)."""
        return interpolate(x, scale_factor=(1, 2, 2), mode="nearest")


class FrameMean(nn.Module):
    """Mean over the frames that remain after the convolution over time."""

    def forward(self, x: Tensor) -> Tensor:
        """Average (b, c, t, h, w) to (b, c, h, w)."""
        return x.mean(2)


def frame_conv(channels_in: int, channels_out: int) -> nn.Conv3d:
    """Build a 3 x 3 convolution within each frame."""
    return nn.Conv3d(channels_in, channels_out, (1, 3, 3), padding=(0, 1, 1))


def timestep_embedding(step: Tensor, channels: int) -> Tensor:
    """Embed steps (b,) as cosines and sines (b, channels) float32 of periods 2 pi to MAX_PERIOD."""
    half = channels // 2
    rates = torch.exp(-math.log(MAX_PERIOD) / half * torch.arange(half, dtype=torch.float32, device=step.device))
    angles = step[:, None].float() * rates
    return torch.cat([angles.cos(), angles.sin()], 1)
