"""LaMa's generator: residual blocks whose channels are partly local and partly global; the global ones are convolved in the
spectrum of the whole picture (fast Fourier convolution, Chi et al. 2020).

Modules are called as in the published code, so that published tensors keep their names.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn

Pair = tuple[Tensor, Tensor | None]
"""local and global channels; a layer may have none of the latter"""
GIVEN, WANTED = 4, 3
"""channels: colours and the hole; colours"""


@dataclass(frozen=True)
class LamaConfig:
    """The defaults are Big LaMa, as published."""

    channels: int = 64
    """of the first layer; each halving of the picture doubles them"""
    halvings: int = 3
    blocks: int = 18
    share: float = 0.75
    """of the channels of a residual block that are global"""

    @property
    def multiple_px(self) -> int:
        """What height and width must be multiples of."""
        return 2**self.halvings


class Generator(nn.Module):
    """(b, 4, h, w) in 0..1, holes black and the fourth channel 1 inside -> (b, 3, h, w) in 0..1; h, w multiples of 8."""

    def __init__(self, config: LamaConfig) -> None:
        super().__init__()
        self.config = config
        widths = [config.channels * 2**level for level in range(config.halvings + 1)]
        shares = [0.0] * config.halvings + [config.share]
        down = [Layer(widths[i], widths[i + 1], (0.0, shares[i + 1]), stride=2) for i in range(config.halvings)]
        deep = [Residual(widths[-1], config.share) for _ in range(config.blocks)]
        up = [part for wide, narrow in zip(widths[:0:-1], widths[-2::-1], strict=True) for part in _doubled(wide, narrow)]
        first = [nn.ReflectionPad2d(3), Layer(GIVEN, widths[0], (0.0, 0.0), kernel=7, padding=0)]
        last = [nn.ReflectionPad2d(3), nn.Conv2d(widths[0], WANTED, 7), nn.Sigmoid()]
        self.model = nn.Sequential(*first, *down, *deep, Joined(), *up, *last)

    def forward(self, x: Tensor) -> Tensor:
        """See the class."""
        return self.model(x)


class Layer(nn.Module):
    """Convolution, batch normalisation, ReLU, of local and of global channels; `shares` of them are global before and after."""

    def __init__(self, given: int, wanted: int, shares: tuple[float, float], *, kernel: int = 3, stride: int = 1,
                 padding: int = 1) -> None:  # fmt: skip
        super().__init__()
        self.ffc = FourierConvolution(given, wanted, shares, kernel, stride, padding)
        self.bn_l = nn.BatchNorm2d(wanted - int(wanted * shares[1]))
        self.bn_g = nn.BatchNorm2d(int(wanted * shares[1])) if shares[1] else nn.Identity()

    def forward(self, x: Tensor | Pair) -> Pair:
        """A tensor is local throughout."""
        here, everywhere = self.ffc((x, None) if isinstance(x, Tensor) else x)
        return self.bn_l(here).relu_(), None if everywhere is None else self.bn_g(everywhere).relu_()


class FourierConvolution(nn.Module):
    """Four ways, from local and global channels to local and global ones; those of no channels are left out."""

    def __init__(self, given: int, wanted: int, shares: tuple[float, float], kernel: int, stride: int, padding: int) -> None:
        super().__init__()
        (given_l, given_g), (wanted_l, wanted_g) = _parts(given, shares[0]), _parts(wanted, shares[1])
        shape: dict[str, Any] = {"kernel_size": kernel, "stride": stride, "padding": padding, "bias": False,
                                 "padding_mode": "reflect"}  # fmt: skip
        self.convl2l = nn.Conv2d(given_l, wanted_l, **shape)
        self.convl2g = nn.Conv2d(given_l, wanted_g, **shape) if wanted_g else None
        self.convg2l = nn.Conv2d(given_g, wanted_l, **shape) if given_g else None
        self.convg2g = SpectralTransform(given_g, wanted_g) if given_g and wanted_g else None

    def forward(self, x: Pair) -> Pair:
        """(b, c, h, w) each -> (b, c', h', w') each."""
        here, everywhere = x
        local = self.convl2l(here)
        if self.convg2l is not None:
            local = local + self.convg2l(everywhere)
        spread = None if self.convl2g is None else self.convl2g(here)
        if spread is not None and self.convg2g is not None:
            spread = spread + self.convg2g(everywhere)
        return local, spread


class SpectralTransform(nn.Module):
    """Half as many channels, added to what a convolution makes of their spectrum, and wide again."""

    def __init__(self, given: int, wanted: int) -> None:
        super().__init__()
        half = wanted // 2
        self.conv1 = nn.Sequential(nn.Conv2d(given, half, 1, bias=False), nn.BatchNorm2d(half), nn.ReLU(inplace=True))
        self.fu = FourierUnit(half)
        self.conv2 = nn.Conv2d(half, wanted, 1, bias=False)

    def forward(self, x: Tensor) -> Tensor:
        """(b, c, h, w) -> (b, c', h, w)."""
        x = self.conv1(x)
        return self.conv2(x + self.fu(x))


class FourierUnit(nn.Module):
    """A 1 x 1 convolution of the real and imaginary parts of a spectrum; the transforms are in float32 whatever the type."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.conv_layer = nn.Conv2d(2 * channels, 2 * channels, 1, bias=False)
        self.bn = nn.BatchNorm2d(2 * channels)

    def forward(self, x: Tensor) -> Tensor:
        """(b, c, h, w) -> the same shape. Real and imaginary part of a channel lie side by side."""
        spectrum = torch.view_as_real(torch.fft.rfftn(x.float(), dim=(-2, -1), norm="ortho"))
        parts = spectrum.permute(0, 1, 4, 2, 3).flatten(1, 2).to(x.dtype)
        parts = self.bn(self.conv_layer(parts)).relu_().unflatten(1, (-1, 2)).permute(0, 1, 3, 4, 2)
        back = torch.view_as_complex(parts.float().contiguous())
        return torch.fft.irfftn(back, s=x.shape[-2:], dim=(-2, -1), norm="ortho").to(x.dtype)


class Residual(nn.Module):
    """Two layers beside a shortcut."""

    def __init__(self, channels: int, share: float) -> None:
        super().__init__()
        self.conv1, self.conv2 = (Layer(channels, channels, (share, share)) for _ in range(2))

    def forward(self, x: Pair) -> Pair:
        """The same shapes."""
        here, everywhere = self.conv2(self.conv1(x))
        assert x[1] is not None and everywhere is not None
        return x[0] + here, x[1] + everywhere


class Joined(nn.Module):
    """Local and global channels, one after the other."""

    def forward(self, x: Pair) -> Tensor:
        """(b, c, h, w)."""
        return torch.cat([part for part in x if part is not None], 1)


def _parts(channels: int, share: float) -> tuple[int, int]:
    return channels - int(channels * share), int(channels * share)


def _doubled(wide: int, narrow: int) -> list[nn.Module]:
    """Twice the size, half the channels."""
    grow = nn.ConvTranspose2d(wide, narrow, 3, stride=2, padding=1, output_padding=1)
    return [grow, nn.BatchNorm2d(narrow), nn.ReLU(inplace=True)]
