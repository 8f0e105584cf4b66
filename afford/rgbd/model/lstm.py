"""Convolutional LSTM (Shi et al. 2015) without peepholes, its state carried from frame to frame."""

from __future__ import annotations

import torch
from torch import Tensor, nn

State = tuple[Tensor, Tensor]
"""hidden and cell state, each (b, c, h, w)"""


class ConvLSTM(nn.Module):
    """One layer: gates are a 3 x 3 convolution of input and hidden state."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.width = width
        self.gates = nn.Conv2d(2 * width, 4 * width, 3, padding=1)

    def step(self, x: Tensor, state: State) -> State:
        """One frame (b, c, h, w): gates input, forget, output and candidate, in this order of channels."""
        hidden, cell = state
        enter, keep, leave, new = self.gates(torch.cat([x, hidden], 1)).chunk(4, 1)
        cell = keep.sigmoid() * cell + enter.sigmoid() * new.tanh()
        return leave.sigmoid() * cell.tanh(), cell

    def forward(self, frames: Tensor) -> Tensor:
        """(b, t, c, h, w) -> the hidden state after every frame, the same shape; it starts at 0."""
        nothing = torch.zeros_like(frames[:, 0])
        state, found = (nothing, nothing), []
        for x in frames.unbind(1):
            state = self.step(x, state)
            found.append(state[0])
        return torch.stack(found, 1)

    def remember(self, steps: int) -> None:
        """Start with channels that remember for 1 to `steps` frames (Tallec and Ollivier 2018): forget gates log u, input gates
        -log u, u uniform in 1..steps. With a bias of 1 for all, a tenth is left of what was seen seven frames ago.
        """
        with torch.no_grad():
            spans = torch.empty_like(self.gates.bias[: self.width]).uniform_(1, steps).log()  # type: ignore[index]
            self.gates.bias[: 2 * self.width] = torch.cat([-spans, spans])  # type: ignore[index]  # it has a bias
