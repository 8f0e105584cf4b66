"""The whole model: two streams, fused, remembered over frames; the last frame decoded."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

from afford.models.sor3d.attention import Attention
from afford.models.sor3d.config import Sor3dConfig
from afford.models.sor3d.decoder import Decoder
from afford.models.sor3d.encoder import Encoder
from afford.models.sor3d.inputs import Frames
from afford.models.sor3d.lstm import ConvLSTM
from afford.models.sor3d.parts import Action, Residual, xavier


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
        self.memory = nn.ModuleList(ConvLSTM(width) for _ in range(2))
        self.attention = Attention(width, config.rescale) if config.attention else None
        self.decoder = Decoder(config.widths, config.decoder_widths, streams, config.labels, config.norm)
        self.action = Action(width, config.actions, config.norm)

    def forward(self, frames: Frames) -> Said:
        """n sequences of t frames -> what is said of the last one."""
        seen, skips = self._seen(frames)
        remembered = seen
        for layer in self.memory:
            remembered = layer(remembered)
        last = remembered[:, -1]
        attention = None if self.attention is None else self.attention(seen[:, -1], last)
        return Said(self.decoder(last, skips, attention), self.action(last, seen.shape[1]), attention)

    def expect(self, pixels: Tensor, actions: Tensor) -> None:
        """Start from these shares of the classes, (10,) and (9,), whatever is seen (Lin et al. 2017): else the first thing that
        all layers learn together is how rare regions are."""
        with torch.no_grad():
            self.decoder.classes.weight.zero_()
            self.decoder.classes.bias.copy_(pixels.log())  # type: ignore[union-attr]  # it has a bias
            self.action.layers[-1].weight.zero_()  # type: ignore[operator]  # a linear layer
            self.action.layers[-1].bias.copy_(actions.log())  # type: ignore[operator,union-attr]

    def _seen(self, frames: Frames) -> tuple[Tensor, list[list[Tensor]]]:
        """Fused features of every frame (n, t, c, h, w), and the features of the last frame before each pooling, by stream."""
        count, steps = frames.appearance.shape[:2]
        streams = [self.appearance(_laid(self._channels(frames.appearance)))]
        if self.motion is not None:
            streams.append(self.motion(_laid(frames.motion)))
        fused = self.residual(self.fuse(torch.cat([stream[-1] for stream in streams], 1)))
        skips = [[level.unflatten(0, (count, steps))[:, -1] for level in levels] for levels in zip(*streams, strict=True)]
        return fused.unflatten(0, (count, steps)), skips[:-1]

    def _channels(self, appearance: Tensor) -> Tensor:
        return appearance if self.config.depth else appearance[:, :, :3]


def _laid(frames: Tensor) -> Tensor:
    """(n, t, c, h, w) -> (n * t, c, h, w) with the channels of a pixel beside each other: convolutions on a CPU are quicker."""
    return frames.flatten(0, 1).contiguous(memory_format=torch.channels_last)


def build(config: Sor3dConfig, seed: int) -> Sor3d:
    """A new model with Xavier's weights from `seed` alone, its memory's forget gates open; the caller's random state is left.

    Under `torch.device("meta")` it has shapes and no weights.
    """
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        model = Sor3d(config)
        xavier(model)
        for layer in model.memory:
            layer.remember()  # type: ignore[operator]  # a ConvLSTM
    return model
