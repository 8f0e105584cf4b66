"""Layers of the SOR3D-AFF model: convolution blocks, VGG-style encoder, soft attention, ConvLSTM, action head."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate

from afford.rgbd.model.config import Sor3dConfig


def conv_block(inside: int, outside: int, norm: str) -> nn.Sequential:
    """3 x 3 convolution and ReLU that keep the size, with batch normalisation between them for norm `batch`."""
    between = [nn.BatchNorm2d(outside)] if norm == "batch" else []
    return nn.Sequential(nn.Conv2d(inside, outside, 3, padding=1), *between, nn.ReLU(inplace=True))


def conv_stack(widths: Sequence[int], norm: str) -> nn.Sequential:
    """Convolution blocks from each width to the next."""
    return nn.Sequential(*(conv_block(a, b, norm) for a, b in pairwise(widths)))


class Residual(nn.Module):
    """Pre-activation residual block (He et al. 2016): x + conv(relu(conv(relu(x))))."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.first, self.second = (nn.Conv2d(width, width, 3, padding=1) for _ in range(2))

    def forward(self, x: Tensor) -> Tensor:
        """Add the convolved features: (n, c, h, w) -> the same shape."""
        return x + self.second(self.first(x.relu()).relu())


class ActionHead(nn.Module):
    """Classifier of the action: three layers on the mean and the maximum over positions of the memory.

    At the start of training the pooled memory differs little between sequences (by 7 to 18 % of its size). Without batch
    normalisation all layers follow the part that sequences share and drive the memory into saturation, where it no longer
    separates them. Videos and pictures have statistics of their own.
    """

    def __init__(self, width: int, config: Sor3dConfig) -> None:
        super().__init__()
        inside, self.here = (4 if config.here else 2) * width, config.here
        self.video, self.picture = (nn.BatchNorm1d(inside) if config.norm == "batch" else nn.Identity() for _ in range(2))
        self.layers = nn.Sequential(nn.Linear(inside, width), nn.ReLU(), nn.Linear(width, width), nn.ReLU(),
                                    nn.Linear(width, config.actions))  # fmt: skip

    def forward(self, remembered: Tensor, seen: Tensor) -> Tensor:
        """Classify memory (n, c, h, w) after frames of features (n, t, c, h, w) as logits (n, actions).

        With a norm, training needs n of 2 or more.
        """
        features = [remembered, seen[:, -1]] if self.here else [remembered]
        pooled = torch.cat([value for one in features for value in (one.mean((-2, -1)), one.amax((-2, -1)))], 1)
        found: Tensor = self.layers((self.video if seen.shape[1] > 1 else self.picture)(pooled))
        return found


def init_xavier(model: nn.Module) -> None:
    """Initialise convolutions and linear layers with Xavier's uniform weights (Glorot and Bengio 2010) and zero biases."""
    for module in model.modules():
        if isinstance(module, nn.Conv2d | nn.Linear):
            nn.init.xavier_uniform_(module.weight)
            if module.bias is not None:
                nn.init.zeros_(module.bias)


CONVOLUTIONS = (2, 2, 3, 4)
"""convolutions of the encoder at full, half, quarter and eighth resolution"""


class Encoder(nn.Module):
    """VGG-style encoder: 11 convolutions and 3 poolings, the first 11 convolutions of VGG16 at the paper's width.

    (n, c, h, w) -> features before each pooling and after the last one, with sides h, h // 2, h // 4, h // 8 (300, 150, 75,
    37).
    """

    def __init__(self, channels: int, widths: Sequence[int], norm: str) -> None:
        super().__init__()
        befores = (channels, *widths[:-1])
        self.stages = nn.ModuleList(
            conv_stack((before, *[width] * count), norm) for before, width, count in zip(befores, widths, CONVOLUTIONS, strict=True)
        )
        self.pool = nn.MaxPool2d(2)

    def forward(self, x: Tensor) -> list[Tensor]:
        """Features at full, half, quarter and eighth resolution."""
        found = []
        for n, stage in enumerate(self.stages):
            x = stage(self.pool(x) if n else x)
            found.append(x)
        return found


class Attention(nn.Module):
    """Soft attention over positions: 1 x 1 convolution of the current features and the memory, then softmax."""

    def __init__(self, width: int, rescale: bool) -> None:
        super().__init__()
        self.score, self.rescale = nn.Conv2d(2 * width, 1, 1), rescale

    def forward(self, seen: Tensor, remembered: Tensor) -> Tensor:
        """Attention (n, 1, h, w) from two (n, c, h, w); it sums to 1, or has a mean of 1 when it is rescaled."""
        score = self.score(torch.cat([seen, remembered], 1))
        share = score.flatten(1).softmax(-1).view_as(score)
        return share * score[0].numel() if self.rescale else share


def upsample_nearest(attention: Tensor, size: tuple[int, int]) -> Tensor:
    """Upsample attention to a larger grid by nearest neighbour."""
    return interpolate(attention, size, mode="nearest")


State = tuple[Tensor, Tensor]
"""hidden and cell state, each (b, c, h, w)"""


class ConvLSTM(nn.Module):
    """One layer of a convolutional LSTM (Shi et al. 2015) without peepholes.

    The gates are a 3 x 3 convolution of input and hidden state.
    """

    def __init__(self, width: int) -> None:
        super().__init__()
        self.width = width
        self.gates = nn.Conv2d(2 * width, 4 * width, 3, padding=1)

    def step(self, x: Tensor, state: State) -> State:
        """Update the state with one frame (b, c, h, w); gate channels are input, forget, output, candidate."""
        hidden, cell = state
        enter, keep, leave, new = self.gates(torch.cat([x, hidden], 1)).chunk(4, 1)
        cell = keep.sigmoid() * cell + enter.sigmoid() * new.tanh()
        return leave.sigmoid() * cell.tanh(), cell

    def forward(self, frames: Tensor) -> Tensor:
        """Hidden state after every frame: (b, t, c, h, w) -> the same shape. The first state is 0."""
        nothing = torch.zeros_like(frames[:, 0])
        state, found = (nothing, nothing), []
        for x in frames.unbind(1):
            state = self.step(x, state)
            found.append(state[0])
        return torch.stack(found, 1)

    def init_memory_span(self, steps: int) -> None:
        """Initialise the biases so that channels remember for 1 to `steps` frames (Tallec and Ollivier 2018).

        Forget gates get log u, input gates -log u, u uniform in 1..steps. With a bias of 1 everywhere only a tenth of the
        input would be left after seven frames.
        """
        with torch.no_grad():
            spans = torch.empty_like(self.gates.bias[: self.width]).uniform_(1, steps).log()  # type: ignore[index]
            self.gates.bias[: 2 * self.width] = torch.cat([-spans, spans])  # type: ignore[index]  # it has a bias
