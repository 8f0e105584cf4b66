"""Pre-training of the first stream: its encoder with an LSTM that tells the action of a clip (SOR3D-AFF: 50 epochs of UTKinect)."""

from __future__ import annotations

from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from afford.rgbd.model.encoder import Encoder
from afford.rgbd.model.model import Sor3d
from afford.rgbd.model.parts import xavier

FILE = "encoder.safetensors"


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


def save(encoder: nn.Module, folder: Path) -> None:
    """The weights of an encoder alone."""
    folder.mkdir(parents=True, exist_ok=True)
    save_file({name: tensor.detach().cpu().contiguous() for name, tensor in encoder.state_dict().items()}, folder / FILE)


def load(encoder: nn.Module, path: Path) -> None:
    """Put them into an encoder. ValueError when they are those of another."""
    try:
        encoder.load_state_dict(load_file(path))
    except (OSError, SafetensorError, RuntimeError) as error:
        raise ValueError(f"{path.name}: expected the encoder of a model of this width, depth and norm; {error}") from error
