"""All that decides a shape of VIDM. The defaults are the published model (2HandedAfforder, hand inpainting)."""

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
    """The published sizes; tests have smaller ones."""

    size_px: int = 256
    """side of the square frames; a latent has a quarter of it"""
    frames: int = 4
    """of a group, the target last"""
    channels: int = 256
    """of the U-Net at its finest level; multiples of 32"""
    multiples: tuple[int, ...] = (1, 2, 3, 4)
    """of `channels`, level by level"""
    blocks: int = 2
    """residual blocks of a level"""
    attention_at: tuple[int, ...] = (2, 4, 8)
    """strides, in the latent, at which all positions of all frames attend to each other"""
    heads: int = 8
    codes: int = 8192
    """entries of the codebook"""
    first_stage: tuple[int, ...] = (128, 256, 512)
    """channels of the levels between a frame and its latent; three levels are a stride of 4"""
    first_stage_blocks: int = 2


def read_config(path: Path) -> VidmConfig:
    """The config that a model was saved with; ValueError names the file and the field."""
    try:
        fields = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise ValueError(f"{path}: expected the config of a saved VIDM; {error}") from error
    if not isinstance(fields, dict) or fields.pop("format", None) != FORMAT:
        raise ValueError(f'{path}: expected "format": "{FORMAT}"; '
                         'write the folder with afford.extraction.inpaint.vidm_model.save')
    unknown = sorted(fields.keys() - {field.name for field in dataclasses.fields(VidmConfig)})
    if unknown:
        raise ValueError(f"{path}: expected the fields of VidmConfig, got {', '.join(unknown)} too")
    plain: dict[str, Any] = {name: tuple(value) if isinstance(value, list) else value for name, value in fields.items()}
    return VidmConfig(**plain)


def config_text(config: VidmConfig) -> str:
    """What `read_config` reads."""
    return json.dumps({"format": FORMAT, **dataclasses.asdict(config)}, indent=2, sort_keys=True) + "\n"


GROUPS = 32
LATENT, CONDITION = 3, 4
"""channels of a latent; of what is known of a frame: its blanked latent and its mask"""
MAX_PERIOD = 10_000


class Unet(nn.Module):
    """(b, 7, t, h, w) noisy target beside what is known of each frame, and (b,) steps -> (b, 3, h, w) the noise in the target."""

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
        self.out = nn.Sequential(Norm(GROUPS, first), nn.SiLU(), join, Joined(), nn.Conv2d(first, LATENT, 3, padding=1))

    def forward(self, x: Tensor, step: Tensor) -> Tensor:
        """See the class."""
        emb = self.time_embed(waves(step, self.channels).to(x.dtype))
        skips = []
        for block in self.input_blocks:
            x = block(x, emb)
            skips.append(x)
        x = self.middle_block(x, emb)
        for block in self.output_blocks:
            x = block(torch.cat([x, skips.pop()], 1), emb)
        return self.out(x)

    def _down(self, config: VidmConfig) -> tuple[nn.ModuleList, list[int]]:
        blocks = [Block([within(LATENT + CONDITION, self.channels)])]
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

    def _level(self, given: int, wanted: int, stride: int, config: VidmConfig) -> list[nn.Module]:
        attention = [Attention(wanted, config.heads)] if stride in config.attention_at else []
        return [self._res(given, wanted), *attention]

    def _res(self, given: int, wanted: int, resample: str = "") -> Residual:
        return Residual(given, wanted, self.emb, resample)


class Block(nn.ModuleList):
    """Layers one after the other; residual ones are told the step."""

    def forward(self, x: Tensor, emb: Tensor) -> Tensor:
        """(b, c, t, h, w) -> (b, c', t, h', w')."""
        for layer in self:
            x = layer(x, emb) if isinstance(layer, Residual) else layer(x)
        return x


class Residual(nn.Module):
    """Two convolutions within each frame; `resample` halves ("down") or doubles ("up") height and width."""

    def __init__(self, given: int, wanted: int, emb: int, resample: str = "") -> None:
        super().__init__()
        self.resample = {"": nn.Identity(), "down": Halve(), "up": Twice()}[resample]
        self.in_layers = nn.Sequential(Norm(GROUPS, given), nn.SiLU(), within(given, wanted))
        self.emb_layers = nn.Sequential(nn.SiLU(), nn.Linear(emb, wanted))
        self.out_layers = nn.Sequential(Norm(GROUPS, wanted), nn.SiLU(), nn.Identity(), within(wanted, wanted))
        self.skip_connection = nn.Identity() if given == wanted else nn.Conv3d(given, wanted, 1)

    def forward(self, x: Tensor, emb: Tensor) -> Tensor:
        """(b, c, t, h, w), (b, e) -> (b, c', t, h', w')."""
        h = self.in_layers[2](self.resample(self.in_layers[:2](x)))
        h = h + self.emb_layers(emb)[:, :, None, None, None]
        return self.skip_connection(self.resample(x)) + self.out_layers(h)


class Attention(nn.Module):
    """Every position of every frame attends to every other."""

    def __init__(self, channels: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.norm = Norm(GROUPS, channels)
        self.qkv = nn.Conv1d(channels, 3 * channels, 1)
        self.proj_out = nn.Conv1d(channels, channels, 1)

    def forward(self, x: Tensor) -> Tensor:
        """(b, c, t, h, w) -> the same shape."""
        flat = x.flatten(2)
        per_head = self.qkv(self.norm(flat)).unflatten(1, (self.heads, -1)).transpose(2, 3)
        q, k, v = per_head.chunk(3, dim=3)
        seen = scaled_dot_product_attention(q, k, v).transpose(2, 3).flatten(1, 2)
        return (flat + self.proj_out(seen)).view_as(x)


class Norm(nn.GroupNorm):
    """Group normalisation over all frames at once, in float32 whatever the type."""

    def forward(self, x: Tensor) -> Tensor:
        """The same shape and type."""
        scale, shift = self.weight.float(), self.bias.float()
        return torch.nn.functional.group_norm(x.float(), self.num_groups, scale, shift, self.eps).to(x.dtype)


class Halve(nn.Module):
    """Mean of 2 x 2 pixels of a frame."""

    def forward(self, x: Tensor) -> Tensor:
        """(b, c, t, h, w) -> (b, c, t, h / 2, w / 2)."""
        return avg_pool2d(x.flatten(1, 2), 2).unflatten(1, x.shape[1:3])


class Twice(nn.Module):
    """Every pixel of a frame four times."""

    def forward(self, x: Tensor) -> Tensor:
        """(b, c, t, h, w) -> (b, c, t, 2 h, 2 w)."""
        return interpolate(x, scale_factor=(1, 2, 2), mode="nearest")


class Joined(nn.Module):
    """Frames into one, after the join has left as good as one."""

    def forward(self, x: Tensor) -> Tensor:
        """(b, c, t, h, w) -> (b, c, h, w)."""
        return x.mean(2)


def within(given: int, wanted: int) -> nn.Conv3d:
    """A 3 x 3 convolution within each frame."""
    return nn.Conv3d(given, wanted, (1, 3, 3), padding=(0, 1, 1))


def waves(step: Tensor, channels: int) -> Tensor:
    """(b,) steps -> (b, channels) float32 cosines and sines of periods 2 pi to MAX_PERIOD."""
    half = channels // 2
    rates = torch.exp(-math.log(MAX_PERIOD) / half * torch.arange(half, dtype=torch.float32, device=step.device))
    angles = step[:, None].float() * rates
    return torch.cat([angles.cos(), angles.sin()], 1)
