"""The small model on a pretrained image encoder: EfficientNet-Lite0, trained on ImageNet's photographs and kept as it is.

What is learned from rendered pictures then begins at features of real ones. Words, transformer and decoder are those of `small`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import torch
from torch import Tensor, cat, nn
from torch.nn.functional import interpolate

from afford.models.efficientnet_lite import WIDTHS, EfficientNetLite0, read_encoder
from afford.models.encoder_place import encoder_path
from afford.models.word_vectors import WordVectors
from afford.twohands.model.backbones import freeze
from afford.twohands.model.interface import ModelConfig
from afford.twohands.model.small import Decoder, Encoder, Residual, Small, mlp

MET = "published weights, 2026-11: its encoder names photographs of an espresso and of a cat"

class LiteEncoder(Encoder):
    """Encoder of `small` whose features without words are those of a frozen EfficientNet-Lite0."""

    def __init__(self, config: ModelConfig, backbone: EfficientNetLite0) -> None:
        super().__init__(config.size_px, config.widths, config.convolutions, config.depth, config.heads, config.dropout)
        c4, c8, c16 = config.widths
        del self.stem
        self.stage4, self.stage8 = narrowed(WIDTHS[0], c4), nn.Sequential(narrowed(WIDTHS[1], c8), Residual(c8))
        self.plain16 = narrowed(WIDTHS[2] + WIDTHS[3], c16)
        self.backbone = backbone
        freeze(backbone)

    def train(self, mode: bool = True) -> LiteEncoder:
        """Set the mode of all but the backbone, whose statistics stay those of its photographs."""
        super().train(mode)
        self.backbone.eval()
        return self

    def see(self, image: Tensor) -> tuple[Tensor, Tensor, Tensor | None]:
        """Features of an image (b, 3, H, W) RGB 0..1 without words, at strides 4, 8 and 16."""
        with torch.no_grad():
            seen = self.backbone(image)
        wide = interpolate(seen.stride32, seen.stride16.shape[2:], mode="bilinear", align_corners=False)
        return self.stage4(seen.stride4), self.stage8(seen.stride8), self.plain16(cat([seen.stride16, wide], dim=1))


BACKBONE = "encoder.backbone."
"""prefix of the backbone's tensors in a model"""


def completed(weights: Mapping[str, Tensor], backbone: Path | None = None) -> dict[str, Tensor]:
    """Add the published weights of the backbone where a model's file was written without them.

    backbone: file of the published weights, by default that of set-up, which verified it. ValueError, one sentence, without it.
    """
    if any(name.startswith(BACKBONE) for name in weights):
        return dict(weights)
    published = read_encoder(str(backbone or encoder_path())).state_dict()
    return {**weights, **{f"{BACKBONE}{name}": tensor for name, tensor in published.items()}}


def narrowed(before: int, after: int) -> nn.Sequential:
    """Fewer channels by a 1 x 1 convolution, normalised."""
    return nn.Sequential(nn.Conv2d(before, after, 1, bias=False), nn.GroupNorm(8, after), nn.ReLU())


def assemble(config: ModelConfig, pretrained: bool) -> Small:
    """Build the model; its backbone is that of the folder `config.backbones` when `pretrained`, else random.

    ValueError for another file.
    """
    width = config.widths[2]
    words = WordVectors(config.text_buckets, config.text_words, width) if config.text else None
    backbone = read_encoder(config.backbones) if pretrained and config.backbones else EfficientNetLite0()
    decoder = Decoder(config.widths, config.heads, config.decoder_depth, config.decoders, config.hypotheses)
    return Small(config, words, LiteEncoder(config, backbone), decoder, mlp((1 + config.hypotheses) * width, width, 4))
