"""Generator of LaMa: residual blocks of fast Fourier convolutions (Chi et al. 2020).

Channels are partly local and partly global; global channels are convolved in the spectrum of the whole picture. Modules have the
names of the published code, so that published tensors fit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn

Pair = tuple[Tensor, Tensor | None]
"""local and global channels; None without global channels"""
IN_CHANNELS, OUT_CHANNELS = 4, 3
"""input channels: colours and the hole; output channels: colours"""


@dataclass(frozen=True)
class LamaConfig:
    """Sizes of the generator. The defaults are those of the published Big LaMa."""

    channels: int = 64
    """channels of the first layer; each downsampling doubles them"""
    halvings: int = 3
    blocks: int = 18
    share: float = 0.75
    """share of the channels of a residual block that are global"""

    @property
    def multiple_px(self) -> int:
        """Divisor of a valid height and width."""
        return 2**self.halvings


class Generator(nn.Module):
    """Generator: (b, 4, h, w) in 0..1, holes black and the fourth channel 1 inside -> (b, 3, h, w) in 0..1.

    Height and width are multiples of 8.
    """

    def __init__(self, config: LamaConfig) -> None:
        super().__init__()
        self.config = config
        widths = [config.channels * 2**level for level in range(config.halvings + 1)]
        shares = [0.0] * config.halvings + [config.share]
        down = [Layer(widths[i], widths[i + 1], (0.0, shares[i + 1]), stride=2) for i in range(config.halvings)]
        deep = [Residual(widths[-1], config.share) for _ in range(config.blocks)]
        up = [part for wide, narrow in zip(widths[:0:-1], widths[-2::-1], strict=True) for part in _upsample(wide, narrow)]
        first = [nn.ReflectionPad2d(3), Layer(IN_CHANNELS, widths[0], (0.0, 0.0), kernel=7, padding=0)]
        last = [nn.ReflectionPad2d(3), nn.Conv2d(widths[0], OUT_CHANNELS, 7), nn.Sigmoid()]
        self.model = nn.Sequential(*first, *down, *deep, Concat(), *up, *last)

    def forward(self, x: Tensor) -> Tensor:
        """Fill pictures, see the class."""
        return self.model(x)


class Layer(nn.Module):
    """Fourier convolution, batch normalisation and ReLU; `shares` are the shares of global channels of input and output."""

    def __init__(self, channels_in: int, channels_out: int, shares: tuple[float, float], *, kernel: int = 3, stride: int = 1,
                 padding: int = 1) -> None:  # fmt: skip
        super().__init__()
        self.ffc = FourierConvolution(channels_in, channels_out, shares, kernel, stride, padding)
        self.bn_l = nn.BatchNorm2d(channels_out - int(channels_out * shares[1]))
        self.bn_g = nn.BatchNorm2d(int(channels_out * shares[1])) if shares[1] else nn.Identity()

    def forward(self, x: Tensor | Pair) -> Pair:
        """Apply the layer; a plain tensor has local channels only."""
        local, spectral = self.ffc((x, None) if isinstance(x, Tensor) else x)
        return self.bn_l(local).relu_(), None if spectral is None else self.bn_g(spectral).relu_()


class FourierConvolution(nn.Module):
    """Four convolutions, from local and global to local and global channels; those without channels are omitted."""

    def __init__(
        self, channels_in: int, channels_out: int, shares: tuple[float, float], kernel: int, stride: int, padding: int
    ) -> None:
        super().__init__()
        (in_l, in_g), (out_l, out_g) = _parts(channels_in, shares[0]), _parts(channels_out, shares[1])
        shape: dict[str, Any] = {"kernel_size": kernel, "stride": stride, "padding": padding, "bias": False,
                                 "padding_mode": "reflect"}  # fmt: skip
        self.convl2l = nn.Conv2d(in_l, out_l, **shape)
        self.convl2g = nn.Conv2d(in_l, out_g, **shape) if out_g else None
        self.convg2l = nn.Conv2d(in_g, out_l, **shape) if in_g else None
        self.convg2g = SpectralTransform(in_g, out_g) if in_g and out_g else None

    def forward(self, x: Pair) -> Pair:
        """Convolve local and global channels (b, c, h, w) to (b, c', h', w')."""
        local_in, global_in = x
        local_out = self.convl2l(local_in)
        if self.convg2l is not None:
            local_out = local_out + self.convg2l(global_in)
        global_out = None if self.convl2g is None else self.convl2g(local_in)
        if global_out is not None and self.convg2g is not None:
            global_out = global_out + self.convg2g(global_in)
        return local_out, global_out


class SpectralTransform(nn.Module):
    """Bottleneck of half the channels with a residual Fourier unit."""

    def __init__(self, channels_in: int, channels_out: int) -> None:
        super().__init__()
        half = channels_out // 2
        self.conv1 = nn.Sequential(nn.Conv2d(channels_in, half, 1, bias=False), nn.BatchNorm2d(half), nn.ReLU(inplace=True))
        self.fu = FourierUnit(half)
        self.conv2 = nn.Conv2d(half, channels_out, 1, bias=False)

    def forward(self, x: Tensor) -> Tensor:
        """Transform (b, c, h, w) to (b, c', h, w)."""
        x = self.conv1(x)
        return self.conv2(x + self.fu(x))


class FourierUnit(nn.Module):
    """1 x 1 convolution of the real and imaginary parts of a spectrum; Fourier transforms run in float32."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.conv_layer = nn.Conv2d(2 * channels, 2 * channels, 1, bias=False)
        self.bn = nn.BatchNorm2d(2 * channels)

    def forward(self, x: Tensor) -> Tensor:
        """Convolve (b, c, h, w) in the spectrum; real and imaginary parts of a channel are adjacent."""
        spectrum = torch.view_as_real(torch.fft.rfftn(x.float(), dim=(-2, -1), norm="ortho"))
        parts = spectrum.permute(0, 1, 4, 2, 3).flatten(1, 2).to(x.dtype)
        parts = self.bn(self.conv_layer(parts)).relu_().unflatten(1, (-1, 2)).permute(0, 1, 3, 4, 2)
        back = torch.view_as_complex(parts.float().contiguous())
        return torch.fft.irfftn(back, s=x.shape[-2:], dim=(-2, -1), norm="ortho").to(x.dtype)


class Residual(nn.Module):
    """Residual block of two layers."""

    def __init__(self, channels: int, share: float) -> None:
        super().__init__()
        self.conv1, self.conv2 = (Layer(channels, channels, (share, share)) for _ in range(2))

    def forward(self, x: Pair) -> Pair:
        """Apply the block; shapes are unchanged."""
        local, spectral = self.conv2(self.conv1(x))
        assert x[1] is not None and spectral is not None
        return x[0] + local, x[1] + spectral


class Concat(nn.Module):
    """Concatenation of local and global channels."""

    def forward(self, x: Pair) -> Tensor:
        """Concatenate to (b, c, h, w)."""
        return torch.cat([part for part in x if part is not None], 1)


def _parts(channels: int, share: float) -> tuple[int, int]:
    return channels - int(channels * share), int(channels * share)


def _upsample(wide: int, narrow: int) -> list[nn.Module]:
    """Layers that double the size and halve the channels."""
    grow = nn.ConvTranspose2d(wide, narrow, 3, stride=2, padding=1, output_padding=1)
    return [grow, nn.BatchNorm2d(narrow), nn.ReLU(inplace=True)]
