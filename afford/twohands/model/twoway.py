"""Mask decoder of the small model: tokens and image look at each other in turn (Segment Anything, Kirillov et al. 2023), then
every hypothesis weighs the same fine features by a hypernetwork. Both hands decode together, so that a pair of regions is one
hypothesis.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d, interpolate

from afford.twohands.model.common import Attention, mlp


class TwoWayBlock(nn.Module):
    """Self-attention of tokens, tokens to image, perceptron, image to tokens."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.among, self.to_image, self.to_tokens = (Attention(width, heads) for _ in range(3))
        self.mlp = mlp(width, 2 * width, width)
        self.norms = nn.ModuleList(nn.LayerNorm(width) for _ in range(4))

    def forward(self, tokens: Tensor, keep: Tensor, image: Tensor, place: Tensor) -> tuple[Tensor, Tensor]:
        """tokens (b, n, c), keep (b, n) bool, image (b, p, c), place (p, c)."""
        tokens = self.norms[0](tokens + self.among(tokens, tokens, tokens, keep))
        tokens = self.norms[1](tokens + self.to_image(tokens, image + place, image))
        tokens = self.norms[2](tokens + self.mlp(tokens))
        image = self.norms[3](image + self.to_tokens(image + place, tokens, tokens, keep))
        return tokens, image


class Decoder(nn.Module):
    """Features and words -> one mask for each hand and hypothesis, one for the complete object of each hand, and where in the whole
    picture the objects are. Which hand acts is a matter of where things are and how they stand: so what is seen of the objects
    themselves goes into the first token of each hand, of which taxonomy and scores are told.
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

    def forward(self, features: tuple[Tensor, Tensor, Tensor, Tensor], keep: Tensor, place: Tensor) -> tuple[Tensor, ...]:
        """features: stride 4, stride 8, stride-16 tokens, words; keep (b, n) bool of the words; place (p, c16).

        Returns mask logits (b, hands, k, H/4, W/4), score logits (b, hands, k), tokens (b, hands, 1 + k, c16), logits of the
        complete objects (b, hands, H/4, W/4), and their common centre (b, 2) in the whole picture (`Output.centre`).
        """
        stride4, stride8, image, words = features
        count = self.hands * (2 + self.hypotheses)
        tokens = torch.cat([self.queries.flatten(0, 1).expand(len(words), -1, -1), words], dim=1)
        keep = torch.cat([keep.new_ones(len(keep), count), keep], dim=1)
        for block in self.blocks:
            tokens, image = block(tokens, keep, image, place)
        own = tokens[:, :count].unflatten(1, (self.hands, -1))
        own, thing = own[:, :, :-1], self.thing(own[:, :, -1:])
        weight = torch.stack([hyper(own[:, hand, 1:]) for hand, hyper in enumerate(self.hyper)], dim=1)
        drawn = weighed(torch.cat([weight, thing], dim=2), self._fine(stride4, stride8, image))
        seen = self._seen(drawn[:, :, -1], image, place)
        first = own[:, :, :1] + seen[:, None, None]
        score = self.score(own[:, :, 1:] + first)[..., 0]
        return drawn[:, :, :-1], score, torch.cat([first, own[:, :, 1:]], dim=2), drawn[:, :, -1], self.centre(seen)

    def _seen(self, objects: Tensor, image: Tensor, place: Tensor) -> Tensor:
        """(b, c16): what the image tokens say, and where they are, on average over the objects; no gradient goes to their masks."""
        found = avg_pool2d(objects.detach().sigmoid().amax(1, keepdim=True), 4).flatten(1)
        share = found / found.sum(1, keepdim=True).clamp(min=1e-3)
        return self.seen(torch.cat([torch.einsum("bp,bpc->bc", share, image), share @ place], dim=1))

    def _fine(self, stride4: Tensor, stride8: Tensor, image: Tensor) -> Tensor:
        """(b, c4, H/4, W/4): what the image tokens know, made sharp by the encoder's own fine features."""
        height, width = stride8.shape[-2] // 2, stride8.shape[-1] // 2
        x = image.transpose(1, 2).unflatten(2, (height, width))
        x = torch.relu(self.norm8(_twice(self.down8(x)) + self.skip8(stride8)))
        x = torch.relu(self.norm4(_twice(self.down4(x)) + self.skip4(stride4)))
        return torch.relu(self.fine(x))


def weighed(weight: Tensor, fine: Tensor) -> Tensor:
    """Hypernetwork weights (b, s, k, c + 1), the last of them a bias, times features (b, c, h, w): logits (b, s, k, h, w).

    Pixel by pixel, the order in which the features lie in memory (channels last), so that gradients keep it.
    """
    pixels = fine.permute(0, 2, 3, 1).flatten(1, 2)
    flat = weight.flatten(1, 2)
    logits = torch.baddbmm(flat[:, None, :, -1], pixels, flat[..., :-1].transpose(1, 2)).transpose(1, 2)
    return logits.unflatten(1, weight.shape[1:3]).unflatten(3, fine.shape[2:])


def _twice(x: Tensor) -> Tensor:
    return interpolate(x, scale_factor=2.0, mode="bilinear", align_corners=False)
