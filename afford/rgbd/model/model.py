"""The whole model: two streams, fused, remembered over frames; the last frame decoded."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor, nn

from afford.rgbd.model.attention import Attention
from afford.rgbd.model.config import Sor3dConfig
from afford.rgbd.model.decoder import Decoder
from afford.rgbd.model.encoder import Encoder
from afford.rgbd.model.inputs import Frames
from afford.rgbd.model.lstm import ConvLSTM
from afford.rgbd.model.parts import Action, Residual, xavier


class Said(NamedTuple):
    """What a model says of n sequences."""

    logits: Tensor
    """(n, 10, h, w) class of every pixel of the last frame"""
    action: Tensor
    """(n, 9) logits of the action"""
    attention: Tensor | None
    """(n, 1, h', w') over the latent of the last frame; None without attention"""


class Sor3d(nn.Module):
    """Video mode and static mode are one: a picture is a sequence of one frame in which nothing moves."""

    def __init__(self, config: Sor3dConfig) -> None:
        super().__init__()
        self.config, width = config, config.widths[-1]
        self.appearance = Encoder(4 if config.depth else 3, config.widths, config.norm)
        self.motion = Encoder(3, config.widths, config.norm) if config.flow != "none" else None
        streams = 1 if self.motion is None else 2
        self.fuse = nn.Conv2d(streams * width, width, 1)
        self.residual = Residual(width)
        self.level = nn.BatchNorm2d(width) if config.norm == "batch" else nn.Identity()
        self.memory = nn.ModuleList(ConvLSTM(width) for _ in range(2))
        self.attention = Attention(width, config.rescale) if config.attention else None
        self.decoder = Decoder(config.widths, config.decoder_widths, streams, config.labels, config.norm)
        self.action = Action(width, config)

    def forward(self, *groups: Frames) -> Said:
        """Groups of sequences, one length each -> what is said of the last frame of every sequence, in this order.

        All groups of a training step go through at once, so that what is normalised over them is the same for all lengths.
        """
        seen, skips = self._seen(groups)
        lasts = [self._remembered(frames)[:, -1] for frames in seen]
        action = torch.cat([self.action(last, frames) for last, frames in zip(lasts, seen, strict=True)])
        last, here = torch.cat(lasts), torch.cat([frames[:, -1] for frames in seen])
        attention = None if self.attention is None else self.attention(here, last)
        logits = self.decoder(last + here if self.config.here else last, skips, attention)
        return Said(logits + prior(action) if self.config.told else logits, action, attention)

    def expect(self, pixels: Tensor, actions: Tensor) -> None:
        """Start from these shares of the classes, (10,) and (9,), whatever is seen (Lin et al. 2017): else the first thing that
        all layers learn together is how rare regions are.
        """
        pixels = pixels.log() - (prior(actions.log()[None])[0, :, 0, 0] if self.config.told else 0)
        with torch.no_grad():
            for layer, start in ((self.decoder.classes, pixels), (self.action.layers[-1], actions.log())):
                layer.weight.zero_()  # type: ignore[operator,union-attr]  # they have weights and biases
                layer.bias.copy_(start)  # type: ignore[operator,union-attr]

    def _remembered(self, frames: Tensor) -> Tensor:
        for layer in self.memory:
            frames = layer(frames)
        return frames

    def _seen(self, groups: Sequence[Frames]) -> tuple[list[Tensor], list[list[Tensor]]]:
        """Fused features of every frame, (n, t, c, h, w) by group, and the features of last frames before each pooling, by
        stream.
        """
        streams = [self.appearance(_laid([self._channels(frames.appearance) for frames in groups]))]
        if self.motion is not None:
            streams.append(self.motion(_laid([frames.motion for frames in groups])))
        fused = self.level(self.residual(self.fuse(torch.cat([stream[-1] for stream in streams], 1))))
        shapes = [frames.appearance.shape[:2] for frames in groups]
        skips = [[torch.cat([part[:, -1] for part in _parted(level, shapes)]) for level in levels]
                 for levels in zip(*streams, strict=True)]  # fmt: skip
        return _parted(fused, shapes), skips[:-1]

    def _channels(self, appearance: Tensor) -> Tensor:
        return appearance if self.config.depth else appearance[:, :, :3]


def prior(action: Tensor) -> Tensor:
    """(n, 9) logits of the action -> (n, 10, 1, 1) what they add to the logits of pixels: log p, and 0 for the background."""
    return nn.functional.pad(action.log_softmax(-1), (0, 1))[..., None, None]


def _laid(groups: Sequence[Tensor]) -> Tensor:
    """(n, t, c, h, w) of each group -> all frames, (sum of n * t, c, h, w), with the channels of a pixel beside each other:
    convolutions of single precision are quicker on a CPU. In mixed precision they are as they come: convolutions are quick anyhow,
    and few channels side by side keep the normalisation from whole registers.
    """
    frames = torch.cat([frames.flatten(0, 1) for frames in groups])
    mixed = frames.device.type == "cpu" and torch.is_autocast_enabled("cpu")
    return frames if mixed else frames.contiguous(memory_format=torch.channels_last)


def _parted(frames: Tensor, shapes: Sequence[tuple[int, ...]]) -> list[Tensor]:
    """All frames -> (n, t, c, h, w) by group."""
    parts = frames.split([count * steps for count, steps in shapes])
    return [part.unflatten(0, shape) for part, shape in zip(parts, shapes, strict=True)]


def build(config: Sor3dConfig, seed: int) -> Sor3d:
    """A new model with Xavier's weights from `seed` alone, its memory spanning some frames; the caller's random state is left.

    Under `torch.device("meta")` it has shapes and no weights.
    """
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        model = Sor3d(config)
        xavier(model)
        for layer in model.memory:
            layer.remember(config.memory_frames)  # type: ignore[operator]  # a ConvLSTM
    return model
