"""Network that segments what one hand holds: from a crop with the mask of the hand, the held object, the sleeve and the touch.

The encoder is the frozen one of MediaPipe's palm detector, which was trained on pictures of real hands; a small encoder that is
trained adds the masks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import max_pool2d, relu

from afford.extraction.hands.model import layer, reduction, resize
from afford.extraction.hands.palm_encoder import PalmEncoder

HELD, SLEEVE = range(2)
"""channels of the logits; the sleeve is learned beside the object, to tell them apart, and is not used in detection"""
NEAR_PX = 6
"""surroundings of a hand that tell of a touch, px of the crop"""
OWN, OTHER = range(2)
"""channels of the masks: the hand of the crop, and the other hand"""


@dataclass(frozen=True)
class HeldConfig:
    """Sizes of the network."""

    size_px: int = 128
    """height and width of a crop"""
    widths: tuple[int, ...] = (24, 40, 56, 80)
    """channels of the decoder at strides 2, 4, 8 and 16"""
    mask_widths: tuple[int, ...] = (16, 24, 32, 48)
    """channels of the encoder of the masks at the same strides"""


class HeldNetwork(nn.Module):
    """Crops (b, 3, s, s), RGB 0..1, and masks (b, 2, s, s), 0..1 -> logits (b, 2, s, s), and the logit of a touch (b,)."""

    def __init__(self, config: HeldConfig = HeldConfig()) -> None:
        super().__init__()
        self.config, self.encoder = config, PalmEncoder()
        widths, masked = config.widths, config.mask_widths
        self.reduce = nn.ModuleList(reduction(a, b) for a, b in zip(PalmEncoder.widths, widths, strict=True))
        self.masks = nn.ModuleList(nn.Sequential(layer(a, b, 2), layer(b, b)) for a, b in zip((5, *masked), masked, strict=False))
        joined = [a + b for a, b in zip(widths, masked, strict=True)]
        self.whole = nn.Linear(joined[-1], joined[-1])
        outer = (*widths[-2::-1], widths[0])
        self.up = nn.ModuleList(layer(a + b, c) for a, b, c in zip((joined[-1], *outer), joined[-2::-1], outer, strict=False))
        self.head = nn.Conv2d(outer[len(self.up) - 1], 2, 1)
        self.touch = nn.Sequential(nn.Linear(2 * joined[-1] + outer[len(self.up) - 1] + 1, 32), nn.ReLU(), nn.Linear(32, 1))

    def forward(self, crops: Tensor, masks: Tensor) -> tuple[Tensor, Tensor]:
        """Compute the logits."""
        known = [reduce(one) for reduce, one in zip(self.reduce, self.encoder(crops), strict=True)]
        seen, x = list[Tensor](), torch.cat([crops * 2 - 1, masks], 1)
        for down, features in zip(self.masks, known, strict=True):
            x = down(x)
            seen.append(torch.cat([features, resize(x, features.shape)], 1))
        mean, own = seen[-1].mean((2, 3)), masks[:, OWN : OWN + 1]
        y = seen[-1] + relu(self.whole(mean))[..., None, None]
        for up, skip in zip(self.up, seen[-2::-1], strict=False):
            y = up(torch.cat([resize(y, skip.shape), skip], 1))
        logits = self.head(y)
        held = _mean_near(logits[:, HELD : HELD + 1].sigmoid(), own)
        touch = self.touch(torch.cat([mean, _mean_near(seen[-1], own), _mean_near(y, own), held], 1))[:, 0]
        return resize(logits, crops.shape), touch


def _mean_near(features: Tensor, hand: Tensor) -> Tensor:
    """Mean (b, c) of features (b, c, h, w) around the hand (b, 1, s, s)."""
    near = resize(max_pool2d(hand, 2 * NEAR_PX + 1, 1, NEAR_PX), features.shape)
    return (features * near).sum((2, 3)) / near.sum((2, 3)).clamp(min=1e-3)


def inputs(rgb: np.ndarray, masks: np.ndarray) -> tuple[Tensor, Tensor]:
    """Convert crops (b, s, s, 3) uint8 and masks (b, 2, s, s) bool to the inputs of the network."""
    return torch.from_numpy(rgb).permute(0, 3, 1, 2).float() / 255, torch.from_numpy(masks).float()
