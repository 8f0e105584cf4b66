"""The embedded default: about two million parameters, trained from random weights on a CPU.

Words modulate a convolutional encoder, whose tokens pass through a transformer together with the words. A two-way mask decoder
(Segment Anything, Kirillov et al. 2023) then predicts the regions of both hands together, so that a pair of regions is one
hypothesis. Most layers are convolutions, because they make better use of a CPU.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import torch
from torch import Tensor, cat, channels_last, nn
from torch.nn.functional import avg_pool2d, interpolate, scaled_dot_product_attention

from afford.models.normalise import normalised
from afford.models.word_vectors import WordVectors
from afford.twohands.model.interface import Batch, ModelConfig, Output, TwoHands


class Attention(nn.Module):
    """Multi-head attention of queries over keys."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.query, self.key, self.value = (nn.Linear(width, width) for _ in range(3))
        self.out = nn.Linear(width, width)

    def forward(self, query: Tensor, key: Tensor, value: Tensor, keep: Tensor | None = None) -> Tensor:
        """Attend from query (b, n, c) to key and value (b, m, c); `keep` (b, m) bool masks keys. Returns (b, n, c)."""
        q, k, v = self._split(self.query(query)), self._split(self.key(key)), self._split(self.value(value))
        mask = None if keep is None else keep[:, None, None, :]
        return self.out(scaled_dot_product_attention(q, k, v, attn_mask=mask).transpose(1, 2).flatten(2))

    def _split(self, x: Tensor) -> Tensor:
        return x.unflatten(-1, (self.heads, -1)).transpose(1, 2)  # (b, heads, n, c / heads)


class Block(nn.Module):
    """Pre-norm transformer block: self-attention, then a two-layer perceptron of `ratio` times the width."""

    def __init__(self, width: int, heads: int, ratio: int = 4, dropout: float = 0.0) -> None:
        super().__init__()
        self.norm1, self.norm2 = nn.LayerNorm(width), nn.LayerNorm(width)
        self.attention, self.mlp = Attention(width, heads), mlp(width, ratio * width, width)
        self.dropout = nn.Dropout(dropout)

    def forward(self, x: Tensor, keep: Tensor | None = None) -> Tensor:
        """(b, n, c) -> (b, n, c); `keep` (b, n) bool is False for padding tokens."""
        y = self.norm1(x)
        x = x + self.dropout(self.attention(y, y, y, keep))
        return x + self.dropout(self.mlp(self.norm2(x)))


def mlp(*widths: int) -> nn.Sequential:
    """Multi-layer perceptron: linear layers of these widths with GELU between them."""
    layers: list[nn.Module] = []
    for before, after in itertools.pairwise(widths):
        layers += [nn.Linear(before, after), nn.GELU()]
    return nn.Sequential(*layers[:-1])


def sines(height: int, width: int, channels: int, step: float = 1.0) -> Tensor:
    """Sinusoidal positions (height * width, channels) of y and x, `step` apart, at geometric wavelengths."""
    frequency = 1000.0 ** (-torch.arange(channels // 4) / (channels // 4))
    y, x = torch.meshgrid(torch.arange(height) + 0.5, torch.arange(width) + 0.5, indexing="ij")
    angles = [step * axis.flatten()[:, None] * frequency for axis in (y, x)]
    return torch.cat([wave(angle) for angle in angles for wave in (torch.sin, torch.cos)], dim=1)


class Features(NamedTuple):
    """Output of the encoder."""

    stride4: Tensor
    """(b, c4, H/4, W/4)"""
    stride8: Tensor
    """(b, c8, H/8, W/8)"""
    tokens: Tensor
    """(b, H/16 * W/16, c16): stride 16, row by row"""
    words: Tensor
    """(b, n, c16) words after attention to the image; n may be 0"""
    named: Tensor | None
    """(b, 1, h, w): logits to add where things that the task names are seen, at any stride; None for an encoder that knows none"""


class Seen(NamedTuple):
    """Features of the images of a batch before words modulate them."""

    stride4: Tensor
    stride8: Tensor
    stride16: Tensor | None = None
    """added to those that are computed from stride 8"""
    named: Tensor | None = None
    """as in `Features`"""


class Encoder(nn.Module):
    """Image encoder: image and words -> features at strides 4, 8 and 16."""

    def __init__(self, size_px: tuple[int, int], widths: tuple[int, int, int], convolutions: int, depth: int, heads: int,
                 dropout: float) -> None:
        super().__init__()
        c4, c8, c16 = widths
        self.stem = nn.Sequential(nn.PixelUnshuffle(2), _conv(12, c4, stride=2))
        self.stage4: nn.Module = Residual(c4)
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

    def forward(self, batch: Batch, words: Tensor, keep: Tensor) -> Features:
        """Encode the images of a batch with words (b, n, c16); `keep` (b, n) bool is False for padding words."""
        text = (words * keep[..., None]).sum(1) / keep.sum(1, keepdim=True).clamp(min=1)
        seen = self.see(batch)
        stride8 = self.more8(self.tune8(seen.stride8, text))
        coarse = self.stage16(stride8) if seen.stride16 is None else self.stage16(stride8) + seen.stride16
        for tune, more in zip(self.tune16, self.more16, strict=True):
            coarse = more(tune(coarse, text))
        tokens = coarse.flatten(2).transpose(1, 2) + self.place(batch.image)
        count = tokens.shape[1]
        x, there = cat([tokens, words], dim=1), cat([keep.new_ones(len(keep), count), keep], dim=1)
        for block in self.blocks:
            x = block(x, there)
        x = self.norm(x)
        return Features(seen.stride4, stride8, x[:, :count], x[:, count:], seen.named)

    def see(self, batch: Batch) -> Seen:
        """Features of the images of a batch before words modulate them."""
        stride4 = self.stage4(self.stem(normalised(batch.image).contiguous(memory_format=channels_last)))
        return Seen(stride4, self.stage8(stride4))

    def place(self, image: Tensor) -> Tensor:
        """Positions (H/16 * W/16, c16) of the tokens of an image (b, 3, H, W).

        They are measured in tokens of an image of `size_px`, so that the same picture at half the size has the same positions.
        """
        height, width = image.shape[-2:]
        return self.at if (height, width) == self.size_px else self._sines(height, width).to(image.device)

    def _sines(self, height: int, width: int) -> Tensor:
        return sines(height // 16, width // 16, self.norm.normalized_shape[0], self.size_px[0] / height)


class Tune(nn.Module):
    """Feature-wise linear modulation of channels by the words (FiLM, Perez et al. 2018)."""

    def __init__(self, words: int, width: int) -> None:
        super().__init__()
        self.weigh = nn.Sequential(nn.Linear(words, words), nn.ReLU(), nn.Linear(words, 2 * width))

    def forward(self, x: Tensor, text: Tensor) -> Tensor:
        """Scale and shift the channels of x (b, width, h, w) by text (b, words)."""
        scale, shift = self.weigh(text)[..., None, None].chunk(2, dim=1)
        return x * (1 + scale) + shift


class Residual(nn.Module):
    """Residual 3 x 3 convolution."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.body = _conv(width, width)

    def forward(self, x: Tensor) -> Tensor:
        """(b, width, h, w) -> (b, width, h, w)."""
        return x + self.body(x)


def _conv(before: int, after: int, stride: int = 1) -> nn.Sequential:
    return nn.Sequential(nn.Conv2d(before, after, 3, stride, 1, bias=False), nn.GroupNorm(8, after), nn.ReLU())


class TwoWayBlock(nn.Module):
    """Two-way block: self-attention of tokens, tokens to image, perceptron, image to tokens."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.among, self.to_image, self.to_tokens = (Attention(width, heads) for _ in range(3))
        self.mlp = mlp(width, 2 * width, width)
        self.norms = nn.ModuleList(nn.LayerNorm(width) for _ in range(4))

    def forward(self, tokens: Tensor, keep: Tensor, image: Tensor, place: Tensor) -> tuple[Tensor, Tensor]:
        """Update tokens (b, n, c) with mask `keep` (b, n) bool, and image (b, p, c) at positions `place` (p, c)."""
        tokens = self.norms[0](tokens + self.among(tokens, tokens, tokens, keep))
        tokens = self.norms[1](tokens + self.to_image(tokens, image + place, image))
        tokens = self.norms[2](tokens + self.mlp(tokens))
        image = self.norms[3](image + self.to_tokens(image + place, tokens, tokens, keep))
        return tokens, image


class Decoder(nn.Module):
    """Mask decoder: a mask for each hand and hypothesis, the complete object of each hand, and the position of the objects.

    The position and pose of the objects decide which hand acts. So the features of the predicted objects are added to the first
    token of each hand, from which the taxonomy and the scores are predicted.
    """

    def __init__(self, widths: tuple[int, int, int], heads: int, depth: int, hands: int, hypotheses: int) -> None:
        super().__init__()
        c4, c8, c16 = widths
        self.hands, self.hypotheses = hands, hypotheses
        self.queries = nn.Parameter(torch.randn(hands, 2 + hypotheses, c16))
        self.blocks = nn.ModuleList(TwoWayBlock(c16, heads) for _ in range(depth))
        self.down8, self.skip8 = nn.Conv2d(c16, c8, 1), nn.Conv2d(c8, c8, 1)
        self.down4, self.skip4 = nn.Conv2d(c8, c4, 1), nn.Conv2d(c4, c4, 1)
        self.norm8, self.norm4 = nn.GroupNorm(8, c8), nn.GroupNorm(8, c4)
        self.fine = nn.Conv2d(c4, c4, 3, padding=1)
        self.hyper = nn.ModuleList(mlp(c16, c16, c4 + 1) for _ in range(hands))
        self.thing = mlp(c16, c16, c4 + 1)
        self.score = mlp(c16, c16, 1)
        self.seen, self.centre = mlp(2 * c16, c16, c16), mlp(c16, c16, 2)

    def forward(self, features: Features, keep: Tensor, place: Tensor) -> tuple[Tensor, ...]:
        """Decode features; keep (b, n) bool of the words; place (p, c16).

        Returns mask logits (b, hands, k, H/4, W/4), score logits (b, hands, k), tokens (b, hands, 1 + k, c16), logits of the
        complete objects (b, hands, H/4, W/4), and their common centre (b, 2) in the whole picture (`Output.centre`).
        """
        stride4, stride8, image, words, named = features
        count = self.hands * (2 + self.hypotheses)
        tokens = torch.cat([self.queries.flatten(0, 1).expand(len(words), -1, -1), words], dim=1)
        keep = torch.cat([keep.new_ones(len(keep), count), keep], dim=1)
        for block in self.blocks:
            tokens, image = block(tokens, keep, image, place)
        own = tokens[:, :count].unflatten(1, (self.hands, -1))
        own, thing = own[:, :, :-1], self.thing(own[:, :, -1:])
        weight = torch.stack([hyper(own[:, hand, 1:]) for hand, hyper in enumerate(self.hyper)], dim=1)
        drawn = weighed(torch.cat([weight, thing], dim=2), self._fine(stride4, stride8, image))
        if named is not None:
            drawn = drawn + interpolate(named, drawn.shape[3:], mode="bilinear", align_corners=False)[:, None]
        seen = self._seen(drawn[:, :, -1], image, place)
        first = own[:, :, :1] + seen[:, None, None]
        score = self.score(own[:, :, 1:] + first)[..., 0]
        return drawn[:, :, :-1], score, torch.cat([first, own[:, :, 1:]], dim=2), drawn[:, :, -1], self.centre(seen)

    def _seen(self, objects: Tensor, image: Tensor, place: Tensor) -> Tensor:
        """Mean (b, c16) of image tokens and positions over the objects; no gradient flows to the masks of the objects."""
        found = avg_pool2d(objects.detach().sigmoid().amax(1, keepdim=True), 4).flatten(1)
        share = found / found.sum(1, keepdim=True).clamp(min=1e-3)
        return self.seen(torch.cat([torch.einsum("bp,bpc->bc", share, image), share @ place], dim=1))

    def _fine(self, stride4: Tensor, stride8: Tensor, image: Tensor) -> Tensor:
        """Image tokens upsampled to (b, c4, H/4, W/4), with skip connections from the encoder."""
        height, width = stride8.shape[-2] // 2, stride8.shape[-1] // 2
        x = image.transpose(1, 2).unflatten(2, (height, width))
        x = torch.relu(self.norm8(_twice(self.down8(x)) + self.skip8(stride8)))
        x = torch.relu(self.norm4(_twice(self.down4(x)) + self.skip4(stride4)))
        return torch.relu(self.fine(x))


def weighed(weight: Tensor, fine: Tensor) -> Tensor:
    """Multiply hypernetwork weights (b, s, k, c + 1), the last one a bias, with features (b, c, h, w): logits (b, s, k, h, w).

    The product is computed with channels last, which is the memory order of the features, so that gradients keep this order.
    """
    pixels = fine.permute(0, 2, 3, 1).flatten(1, 2)
    flat = weight.flatten(1, 2)
    logits = torch.baddbmm(flat[:, None, :, -1], pixels, flat[..., :-1].transpose(1, 2)).transpose(1, 2)
    return logits.unflatten(1, weight.shape[1:3]).unflatten(3, fine.shape[2:])


def _twice(x: Tensor) -> Tensor:
    return interpolate(x, scale_factor=2.0, mode="bilinear", align_corners=False)


class Small(TwoHands):
    """Word vectors, encoder, decoder, and the taxonomy head on the tokens of the left hand."""

    def __init__(self, config: ModelConfig, words: WordVectors | None, encoder: Encoder, decoder: Decoder,
                 taxonomy: nn.Module) -> None:
        super().__init__()
        self.config = config
        self.words, self.encoder, self.decoder, self.taxonomy = words, encoder, decoder, taxonomy

    def forward(self, batch: Batch) -> Output:
        """Predict the regions of a batch; see `TwoHands`."""
        words, keep = self._read(batch)
        features: Features = self.encoder(batch, words, keep)
        if features.named is not None and not self.training:
            features = features._replace(named=self.config.trust * features.named)
        logits, score, tokens, objects, centre = self.decoder(features, keep, self.encoder.place(batch.image))
        both = (-1, 2, -1, -1, -1)
        return Output(logits.expand(both), score.expand(both[:3]), self.taxonomy(tokens[:, 0].flatten(1)), None,
                      objects.expand(both[:4]), centre)

    def _read(self, batch: Batch) -> tuple[Tensor, Tensor]:
        """Word vectors and their mask; no words for a model without text."""
        if self.words is not None:
            vectors, keep = self.words(batch.task)
            return vectors, keep
        none = batch.image.new_zeros(len(batch.image), 0, self.config.widths[2])
        return none, none[..., 0].bool()


def assemble(config: ModelConfig, _pretrained: bool) -> Small:
    """Build a `Small` with weights from torch's current random state; it has no pretrained backbones."""
    width, hands = config.widths[2], config.decoders
    words = WordVectors(config.text_buckets, config.text_words, width) if config.text else None
    encoder = Encoder(config.size_px, config.widths, config.convolutions, config.depth, config.heads, config.dropout)
    decoder = Decoder(config.widths, config.heads, config.decoder_depth, hands, config.hypotheses)
    return Small(config, words, encoder, decoder, mlp((1 + config.hypotheses) * width, width, 4))
