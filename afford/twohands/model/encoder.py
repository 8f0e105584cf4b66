"""Image encoder of the small model: convolutions that are tuned by the words, down to stride 16, then a transformer that sees the
words as well. Most are convolutions, because a CPU does more of their work in the same time.
"""

from __future__ import annotations

from typing import NamedTuple

from torch import Tensor, cat, channels_last, nn

from afford.twohands.model.common import Block, sines


class Features(NamedTuple):
    """What the encoder hands to the decoder."""

    stride4: Tensor
    """(b, c4, H/4, W/4)"""
    stride8: Tensor
    """(b, c8, H/8, W/8)"""
    tokens: Tensor
    """(b, H/16 * W/16, c16): stride 16, row by row"""
    words: Tensor
    """(b, n, c16), each having seen the image; n may be 0"""


class Encoder(nn.Module):
    """Image and words -> features at three strides."""

    def __init__(self, size_px: tuple[int, int], widths: tuple[int, int, int], convolutions: int, depth: int, heads: int,
                 dropout: float) -> None:
        super().__init__()
        c4, c8, c16 = widths
        self.stem = nn.Sequential(nn.PixelUnshuffle(2), _conv(12, c4, stride=2))
        self.stage4 = Residual(c4)
        self.stage8 = nn.Sequential(_conv(c4, c8, stride=2), Residual(c8))
        self.tune8, self.more8 = Tune(c16, c8), Residual(c8)
        self.stage16 = _conv(c8, c16, stride=2)
        self.tune16 = nn.ModuleList(Tune(c16, c16) for _ in range(convolutions))
        self.more16 = nn.ModuleList(Residual(c16) for _ in range(convolutions))
        self.blocks = nn.ModuleList(Block(c16, heads, ratio=2, dropout=dropout) for _ in range(depth))
        self.norm = nn.LayerNorm(c16)
        self.size_px = size_px
        self.at: Tensor
        self.register_buffer("at", self._sines(*size_px), persistent=False)

    def forward(self, image: Tensor, words: Tensor, keep: Tensor) -> Features:
        """image (b, 3, H, W) normalised, words (b, n, c16), keep (b, n) bool."""
        text = (words * keep[..., None]).sum(1) / keep.sum(1, keepdim=True).clamp(min=1)
        stride4 = self.stage4(self.stem(image.contiguous(memory_format=channels_last)))
        stride8 = self.more8(self.tune8(self.stage8(stride4), text))
        coarse = self.stage16(stride8)
        for tune, more in zip(self.tune16, self.more16, strict=True):
            coarse = more(tune(coarse, text))
        tokens = coarse.flatten(2).transpose(1, 2) + self.place(image)
        count = tokens.shape[1]
        x, seen = cat([tokens, words], dim=1), cat([keep.new_ones(len(keep), count), keep], dim=1)
        for block in self.blocks:
            x = block(x, seen)
        x = self.norm(x)
        return Features(stride4, stride8, x[:, :count], x[:, count:])

    def place(self, image: Tensor) -> Tensor:
        """(H/16 * W/16, c16): where the tokens of an image (b, 3, H, W) are, measured in tokens of an image of `size_px`, so that
        the same picture at half the size has the same places.
        """
        height, width = image.shape[-2:]
        return self.at if (height, width) == self.size_px else self._sines(height, width).to(image.device)

    def _sines(self, height: int, width: int) -> Tensor:
        return sines(height // 16, width // 16, self.norm.normalized_shape[0], self.size_px[0] / height)


class Tune(nn.Module):
    """Scales and shifts channels as the words say (FiLM, Perez et al. 2018)."""

    def __init__(self, words: int, width: int) -> None:
        super().__init__()
        self.weigh = nn.Sequential(nn.Linear(words, words), nn.ReLU(), nn.Linear(words, 2 * width))

    def forward(self, x: Tensor, text: Tensor) -> Tensor:
        """x (b, width, h, w), text (b, words)."""
        scale, shift = self.weigh(text)[..., None, None].chunk(2, dim=1)
        return x * (1 + scale) + shift


class Residual(nn.Module):
    """One 3 x 3 convolution beside the identity."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.body = _conv(width, width)

    def forward(self, x: Tensor) -> Tensor:
        return x + self.body(x)


def _conv(before: int, after: int, stride: int = 1) -> nn.Sequential:
    return nn.Sequential(nn.Conv2d(before, after, 3, stride, 1, bias=False), nn.GroupNorm(8, after), nn.ReLU())
