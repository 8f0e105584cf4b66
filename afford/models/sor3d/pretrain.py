"""Pre-training of the first stream: its encoder with an LSTM that tells the action of a clip (SOR3D-AFF: 50 epochs of UTKinect)."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from afford.models.sor3d.encoder import Encoder
from afford.models.sor3d.model import Sor3d
from afford.models.sor3d.parts import xavier


class ActionLSTM(nn.Module):
    """Encoder, mean over positions, LSTM over frames, a linear layer on its last state."""

    def __init__(self, encoder: Encoder, width: int, actions: int) -> None:
        super().__init__()
        self.encoder = encoder
        self.lstm = nn.LSTM(width, width, batch_first=True)
        self.action = nn.Linear(width, actions)

    def forward(self, appearance: Tensor) -> Tensor:
        """(n, t, c, h, w) -> logits (n, actions)."""
        count, steps = appearance.shape[:2]
        features = self.encoder(appearance.flatten(0, 1))[-1].mean((-2, -1)).unflatten(0, (count, steps))
        found: Tensor = self.action(self.lstm(features)[0][:, -1])
        return found


def head(model: Sor3d, actions: int, seed: int) -> ActionLSTM:
    """An action classifier around the first stream of `model` itself: training it trains the stream."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        made = ActionLSTM(Encoder(1, (1, 1, 1, 1), "none"), model.config.widths[-1], actions)
        xavier(made)
        made.encoder = model.appearance
    return made
