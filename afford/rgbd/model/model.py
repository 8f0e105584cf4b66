"""SOR3D-AFF model: two encoder streams, fusion, ConvLSTM memory, and a decoder of the last frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate

from afford.rgbd.model.config import Sor3dConfig
from afford.rgbd.model.layers import (
    ActionHead,
    Attention,
    ConvLSTM,
    Encoder,
    Residual,
    conv_block,
    conv_stack,
    init_xavier,
    upsample_nearest,
)
from afford.rgbd.model.model_inputs import InputBatch

LATENT = 4
"""convolutions before the first upsampling"""
AFTER = (3, 2, 2)
"""convolutions after each upsampling, without its own"""


class UpBlock(nn.Module):
    """Upsampling to the size of the skip connection, convolution, attention, mixing with the skips, convolutions."""

    def __init__(self, below: int, width: int, skips: int, count: int, norm: str) -> None:
        """`skips` is the number of skip channels of all streams together."""
        super().__init__()
        self.up = conv_block(below, width, norm)
        self.mix = nn.Conv2d(width + skips, width, 1)
        self.then = conv_stack([width] * (count + 1), norm)

    def forward(self, x: Tensor, skips: Sequence[Tensor], attention: Tensor | None) -> Tensor:
        """Upsample features (n, c, h, w) to the size of the skip connections."""
        size = (skips[0].shape[-2], skips[0].shape[-1])
        x = self.up(interpolate(x, size, mode="nearest"))
        if attention is not None:
            x = x * upsample_nearest(attention, size)
        found: Tensor = self.then(self.mix(torch.cat([x, *skips], 1)))
        return found


class Decoder(nn.Module):
    """Class of every pixel of the last frame from its latent: 14 convolutions, three upsamplings, skip connections.

    Attention, where the model has it, multiplies the latent and the output of every upsampling.
    """

    def __init__(self, encoded: Sequence[int], widths: Sequence[int], streams: int, labels: int, norm: str) -> None:
        """`encoded` and `widths` are the channels of encoders and decoder at full, half, quarter and eighth resolution."""
        super().__init__()
        self.latent = conv_stack([encoded[-1], *[widths[-1]] * LATENT], norm)
        rising = zip(reversed(widths), reversed(widths[:-1]), reversed(encoded[:-1]), AFTER, strict=False)
        self.rises = nn.ModuleList(UpBlock(below, width, streams * skip, count, norm) for below, width, skip, count in rising)
        self.classes = nn.Conv2d(widths[0], labels, 1)

    def forward(self, latent: Tensor, skips: Sequence[Sequence[Tensor]], attention: Tensor | None) -> Tensor:
        """Decode a latent (n, c, h, w) and the features of each stream, full to quarter resolution, to logits (n, labels, H, W)."""
        x = self.latent(latent if attention is None else latent * attention)
        for rise, skip in zip(self.rises, reversed(skips), strict=True):
            x = rise(x, skip, attention)
        found: Tensor = self.classes(x)
        return found


class Sor3dOutput(NamedTuple):
    """Output of the model for n sequences."""

    logits: Tensor
    """(n, 10, h, w) class logits of every pixel of the last frame"""
    action: Tensor
    """(n, 9) logits of the action"""
    attention: Tensor | None
    """(n, 1, h', w') over the latent of the last frame; None without attention"""


class Sor3d(nn.Module):
    """Spatio-temporal autoencoder of SOR3D-AFF for videos and pictures: a picture is a still sequence of one frame."""

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
        self.action = ActionHead(width, config)

    def forward(self, *groups: InputBatch) -> Sor3dOutput:
        """Predict the last frame of every sequence; each group holds sequences of one length.

        All groups of a training step pass through the encoders at once, so that batch normalisation is the same for all
        lengths.
        """
        seen, skips = self._encode(groups)
        lasts = [self._remembered(frames)[:, -1] for frames in seen]
        action = torch.cat([self.action(last, frames) for last, frames in zip(lasts, seen, strict=True)])
        last, here = torch.cat(lasts), torch.cat([frames[:, -1] for frames in seen])
        attention = None if self.attention is None else self.attention(here, last)
        logits = self.decoder(last + here if self.config.here else last, skips, attention)
        return Sor3dOutput(logits + action_log_prior(action) if self.config.told else logits, action, attention)

    def init_class_priors(self, pixels: Tensor, actions: Tensor) -> None:
        """Start from the class frequencies (10,) of pixels and (9,) of actions, whatever the input (Lin et al. 2017).

        Otherwise all layers first learn together how rare regions are.
        """
        pixels = pixels.log() - (action_log_prior(actions.log()[None])[0, :, 0, 0] if self.config.told else 0)
        with torch.no_grad():
            for layer, start in ((self.decoder.classes, pixels), (self.action.layers[-1], actions.log())):
                layer.weight.zero_()  # type: ignore[operator,union-attr]  # they have weights and biases
                layer.bias.copy_(start)  # type: ignore[operator,union-attr]

    def _remembered(self, frames: Tensor) -> Tensor:
        for layer in self.memory:
            frames = layer(frames)
        return frames

    def _encode(self, groups: Sequence[InputBatch]) -> tuple[list[Tensor], list[list[Tensor]]]:
        """Encode all frames.

        Returns the fused features of every frame, (n, t, c, h, w) by group, and the features of last frames before each
        pooling, by stream.
        """
        streams = [self.appearance(_flatten_frames([self._channels(frames.appearance) for frames in groups]))]
        if self.motion is not None:
            streams.append(self.motion(_flatten_frames([frames.motion for frames in groups])))
        fused = self.level(self.residual(self.fuse(torch.cat([stream[-1] for stream in streams], 1))))
        shapes = [frames.appearance.shape[:2] for frames in groups]
        skips = [[torch.cat([part[:, -1] for part in _split_groups(level, shapes)]) for level in levels]
                 for levels in zip(*streams, strict=True)]  # fmt: skip
        return _split_groups(fused, shapes), skips[:-1]

    def _channels(self, appearance: Tensor) -> Tensor:
        return appearance if self.config.depth else appearance[:, :, :3]


def action_log_prior(action: Tensor) -> Tensor:
    """Log probabilities of the action as additive logits of pixels: (n, 9) -> (n, 10, 1, 1), 0 for the background."""
    return nn.functional.pad(action.log_softmax(-1), (0, 1))[..., None, None]


def _flatten_frames(groups: Sequence[Tensor]) -> Tensor:
    """Concatenate (n, t, c, h, w) of each group to all frames, (sum of n * t, c, h, w).

    In single precision the memory format is channels last, because convolutions are faster with it on a CPU. In mixed precision
    the format stays: convolutions are fast anyway, and the few channels would keep batch normalisation from using whole
    registers.
    """
    frames = torch.cat([frames.flatten(0, 1) for frames in groups])
    mixed = frames.device.type == "cpu" and torch.is_autocast_enabled("cpu")
    return frames if mixed else frames.contiguous(memory_format=torch.channels_last)


def _split_groups(frames: Tensor, shapes: Sequence[tuple[int, ...]]) -> list[Tensor]:
    """Split all frames into (n, t, c, h, w) by group."""
    parts = frames.split([count * steps for count, steps in shapes])
    return [part.unflatten(0, shape) for part, shape in zip(parts, shapes, strict=True)]


def build(config: Sor3dConfig, seed: int) -> Sor3d:
    """Build a model with Xavier weights from `seed` and a memory that spans some frames; the global random state is kept.

    Under `torch.device("meta")` the model has shapes but no weights.
    """
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        model = Sor3d(config)
        init_xavier(model)
        for layer in model.memory:
            layer.init_memory_span(config.memory_frames)  # type: ignore[operator]  # a ConvLSTM
    return model


def flip_inputs(frames: InputBatch) -> InputBatch:
    """Mirror inputs left to right; motion along x changes its sign, in space as on the image."""
    turned = frames.motion.flip(-1)
    return InputBatch(frames.appearance.flip(-1), torch.cat([-turned[:, :, :1], turned[:, :, 1:]], 2))


def predict_with_flip(model: Sor3d, frames: InputBatch) -> Sor3dOutput:
    """Test-time augmentation: average the probabilities and the attention over a sequence and its mirror image.

    Logits are the logarithm of the mean probability.
    """
    plain, other = model(frames), model(flip_inputs(frames))
    attention = None if plain.attention is None else (plain.attention + other.attention.flip(-1)) / 2
    return Sor3dOutput(_mean_logits(plain.logits, other.logits.flip(-1)), _mean_logits(plain.action, other.action), attention)


def _mean_logits(first: Tensor, second: Tensor) -> Tensor:
    """Logits of the mean of two probabilities."""
    return ((first.softmax(1) + second.softmax(1)) / 2).log()
