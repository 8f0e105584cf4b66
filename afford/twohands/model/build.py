"""From a config to a model: the variants by name."""

from __future__ import annotations

import torch

from afford.common.registry import load
from afford.twohands.model.config import ModelConfig
from afford.twohands.model.model import TwoHands

VARIANTS = {
    "small": "afford.twohands.model.small:assemble",
    "clip": "afford.twohands.model.clip:assemble",
    "vlm": "afford.twohands.model.vlm:assemble",
}
"""name -> function that assembles the parts; the parts never import each other"""


def build(config: ModelConfig, seed: int, *, pretrained: bool = True) -> TwoHands:
    """A new model whose random weights come from `seed` alone; the caller's random state is left as it was.

    `pretrained=False` takes only the architecture of config.backbones. Under `torch.device("meta")` a model has shapes and no
    weights. ValueError when config.backbones cannot be read.
    """
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        model: TwoHands = load(VARIANTS, config.variant)(config, pretrained)
    return model
