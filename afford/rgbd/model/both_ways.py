"""A model asked twice, about a sequence and about its mirror image: what it says is the mean of both answers."""

from __future__ import annotations

import torch
from torch import Tensor

from afford.rgbd.model.inputs import Frames
from afford.rgbd.model.model import Said, Sor3d


def mirrored(frames: Frames) -> Frames:
    """Left is right; motion along x turns round, in space as on the image."""
    turned = frames.motion.flip(-1)
    return Frames(frames.appearance.flip(-1), torch.cat([-turned[:, :, :1], turned[:, :, 1:]], 2))


def both_ways(model: Sor3d, frames: Frames) -> Said:
    """The mean of the probabilities, and of the attention, with the mirror image's turned back; logits are its logarithm."""
    plain, other = model(frames), model(mirrored(frames))
    attention = None if plain.attention is None else (plain.attention + other.attention.flip(-1)) / 2
    return Said(_mean(plain.logits, other.logits.flip(-1)), _mean(plain.action, other.action), attention)


def _mean(first: Tensor, second: Tensor) -> Tensor:
    """Of probabilities, as logits."""
    return ((first.softmax(1) + second.softmax(1)) / 2).log()
