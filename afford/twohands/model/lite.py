"""The small model on a pretrained image encoder: EfficientNet-Lite0, trained on ImageNet's photographs and kept as it is.

What is learned from rendered pictures then begins at features of real ones. Words, transformer and decoder are those of `small`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import torch
from torch import Tensor, cat, nn
from torch.nn.functional import interpolate

from afford.models.efficientnet_lite import CLASSES, WIDTHS, EfficientNetLite0, Pyramid, read_encoder
from afford.models.encoder_place import encoder_path
from afford.models.word_vectors import WordVectors
from afford.twohands.model.backbones import freeze
from afford.twohands.model.class_words import SHOWN, named_classes
from afford.twohands.model.interface import Batch, ModelConfig
from afford.twohands.model.named_things import NamedThings, membership, named_logits
from afford.twohands.model.small import Decoder, Encoder, Residual, Seen, Small, mlp
from afford.twohands.model.style_noise import with_style_noise

MET = "published weights, 2026-11: its encoder names photographs of an espresso and of a cat"

class LiteEncoder(Encoder):
    """Encoder of `small` whose features without words are those of a frozen EfficientNet-Lite0."""

    def __init__(self, config: ModelConfig, backbone: EfficientNetLite0) -> None:
        super().__init__(config.size_px, config.widths, config.convolutions, config.depth, config.heads, config.dropout)
        c4, c8, c16 = config.widths
        del self.stem
        self.stage4, self.stage8 = narrowed(WIDTHS[0], c4), nn.Sequential(narrowed(WIDTHS[1], c8), Residual(c8))
        self.plain16 = narrowed(WIDTHS[2] + WIDTHS[3], c16)
        self.things = NamedThings(c16) if config.classes else None
        self.backbone, self.style_noise = backbone, config.style_noise
        freeze(backbone)

    def train(self, mode: bool = True) -> LiteEncoder:
        """Set the mode of all but the backbone, whose statistics stay those of its photographs."""
        super().train(mode)
        self.backbone.eval()
        return self

    def see(self, batch: Batch) -> Seen:
        """Features of the images of a batch, with what its tasks name; noise on their style in training."""
        with torch.no_grad():
            seen = self.backbone(batch.image)
            scores = self.backbone.class_scores(seen.stride32, SHOWN) if self.things else None
            if self.training and self.style_noise and batch.noise is not None:
                seen = Pyramid(*with_style_noise(seen, self.style_noise, batch.noise))
        wide = interpolate(seen.stride32, seen.stride16.shape[2:], mode="bilinear", align_corners=False)
        plain16, named = self.plain16(cat([seen.stride16, wide], dim=1)), None
        if self.things and scores is not None:
            asked = batch.task if batch.asked is None else batch.asked
            things = membership([named_classes(task) for task in asked], len(SHOWN), scores.device)
            plain16 = plain16 + self.things(scores, things, plain16.shape[2:])
            named = named_logits(scores, things)
        return Seen(self.stage4(seen.stride4), self.stage8(seen.stride8), plain16, named)


BACKBONE = "encoder.backbone."
"""prefix of the backbone's tensors in a model"""
NAMED = "encoder.things."
"""prefix of the tensors that read the classifier's scores"""


def completed(weights: Mapping[str, Tensor], backbone: Path | None = None) -> dict[str, Tensor]:
    """Add the published weights of the backbone where a model's file was written without them.

    backbone: file of the published weights, by default that of set-up, which verified it. ValueError, one sentence, without it.
    """
    if any(name.startswith(BACKBONE) for name in weights):
        return dict(weights)
    classes = CLASSES if any(name.startswith(NAMED) for name in weights) else 0
    published = read_encoder(str(backbone or encoder_path()), classes).state_dict()
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
    classes = CLASSES if config.classes else 0
    backbone = read_encoder(config.backbones, classes) if pretrained and config.backbones else EfficientNetLite0(classes)
    decoder = Decoder(config.widths, config.heads, config.decoder_depth, config.decoders, config.hypotheses)
    return Small(config, words, LiteEncoder(config, backbone), decoder, mlp((1 + config.hypotheses) * width, width, 4))
